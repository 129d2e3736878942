"""`armd webhook [SERIAL] --url URL`: a bridge that posts each measurement as JSON."""

import asyncio
import json
import urllib.request

from armd.daemon.bridges import process
from armd.terminal.arguments import add_arm

HELP = "post each measurement as JSON to a URL"


def add_arguments(parser):
    add_arm(parser)  # SERIAL and --endpoint, as every bridge has them
    parser.add_argument("--url", required=True, help="where measurements are posted")


def run(args):
    """The exit code: 0 after SIGTERM or Ctrl-C."""

    def post(measurement):
        request = urllib.request.Request(args.url, json.dumps(measurement).encode())
        request.add_header("Content-Type", "application/json")
        urllib.request.urlopen(request, timeout=10).close()

    async def bridge(arm):
        with arm.on_measurement(post):  # in a thread of its own: a slow server delays nobody
            process.report_ready("webhook", args.url)
            await asyncio.Event().wait()

    return process.serve(args, bridge)
