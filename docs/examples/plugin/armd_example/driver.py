"""An arm that sends each sample as a UDP datagram: u32 number, then u32 counts, little-endian."""

import socket
import struct

from armd.drivers.packets import PacketDecoder, PacketDriver, SamplePacket
from armd.drivers.plugin import DriverPlugin


class Udp(DriverPlugin):
    port: int  # a key of [driver] beside `kind`, checked as all of armd's are

    def make_driver(self, expectation):
        return UdpDriver(UdpDecoder(expectation), self.port)

    def make_decoder(self, expectation):  # by which `armd replay` reads recordings
        return UdpDecoder(expectation)


class UdpDecoder(PacketDecoder):
    def read_packet(self, data):
        number, *counts = struct.unpack(f"<I{self.expectation.n_joints}I", data)
        return SamplePacket(number, counts)


class UdpDriver(PacketDriver):
    def __init__(self, decoder, port):
        super().__init__(decoder, f"UDP port {port}")
        self._port = port

    def open(self):
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind(("127.0.0.1", self._port))

    def receive(self, timeout_s):
        self._socket.settimeout(timeout_s)
        return self._socket.recv(2048)

    def close(self):
        self._socket.close()
