"""`armd view [SERIAL]`: serve the live page to browsers."""

from __future__ import annotations

import argparse
import ssl
from pathlib import Path

from armd.daemon.bridges import process
from armd.daemon.bridges.listening import add_listen
from armd.daemon.bridges.view.access import Access, is_loopback, read_token
from armd.daemon.bridges.view.server import PageServer
from armd.errors import BadInput
from armd.terminal.arguments import add_arm

LISTEN = "127.0.0.1:8470"
SESSIONS = "measured"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_arm(parser)
    add_listen(parser, LISTEN)
    parser.add_argument(
        "--allow-commands",
        action="store_true",
        help="the page may lead through measurements; change the tip and reload the calibration,"
        " if the daemon obeys",
    )
    parser.add_argument(
        "--sessions",
        type=Path,
        default=Path(SESSIONS),
        metavar="DIR",
        help=f"folder of guided measurements, with artefacts (*.toml) to choose from ({SESSIONS})",
    )
    network = parser.add_argument_group("onto the network (docs/how-to/secure.md)")
    network.add_argument("--certificate", type=Path, metavar="FILE", help="of this machine, PEM")
    network.add_argument("--key", type=Path, metavar="FILE", help="of the certificate, PEM")
    network.add_argument(
        "--token", type=Path, metavar="FILE", help="holds the word that a browser must show once"
    )
    network.add_argument(
        "--name",
        action="append",
        default=[],
        metavar="HOST",
        help="by which browsers reach this machine, as controller.example",
    )


def run(args: argparse.Namespace) -> int:
    """Serve the page.

    Raises `BadInput` for a listener on the network without certificate, token and name.
    """
    if not is_loopback(args.listen[0]):
        _check_network(args)
    tls = _load_tls(args)
    token = None if args.token is None else read_token(args.token)
    access = Access([*args.name, args.listen[0]], token, secure=tls is not None)
    sessions = args.sessions if args.allow_commands else None
    server = PageServer(access, args.serial, args.endpoint, sessions)
    return process.serve_alone(lambda: server.serve(args.listen, tls))


def _check_network(args: argparse.Namespace) -> None:
    for option in ("certificate", "key", "token", "name"):
        if not getattr(args, option):
            problem = f"{args.listen[0]}:{args.listen[1]} without --{option}"
            expected = "127.0.0.1, or certificate, key, token and name (docs/how-to/secure.md)"
            raise BadInput("the command line", "--listen", problem, expected)


def _load_tls(args: argparse.Namespace) -> ssl.SSLContext | None:
    if args.certificate is None and args.key is None:
        return None
    if args.certificate is None or args.key is None:
        raise BadInput("the command line", "--certificate, --key", "one of them", "both")
    context = ssl.create_default_context(ssl.Purpose.CLIENT_AUTH)
    context.minimum_version = ssl.TLSVersion.TLSv1_2
    try:
        context.load_cert_chain(args.certificate, args.key)
    except ssl.SSLError as error:
        expected = "a certificate and its key, PEM"
        raise BadInput(args.certificate, "the file", error.reason or "none", expected) from error
    return context
