"""Servos on a pty, for tests: written from the makers' manuals alone, without armd's codecs.

They answer in a thread, as fast as Python can; `line` spoils what they say.
"""

import os
import select
import threading
from contextlib import suppress

from support.pty_link import PtyLink


def dxl_crc(data):
    crc = 0
    for byte in data:
        crc ^= byte << 8
        for _ in range(8):
            crc = (crc << 1 ^ 0x8005) & 0xFFFF if crc & 0x8000 else crc << 1
    return crc.to_bytes(2, "little")


def stuffed(body):
    return bytes(body).replace(b"\xff\xff\xfd", b"\xff\xff\xfd\xfd")


class Feetech:
    kind = "feetech"
    position, temperature, torque, delay, model = 56, 63, 40, 7, 777

    @staticmethod
    def table(servo, model=777, homing=0, firmware=(3, 10)):
        registers = bytearray(256)
        registers[0:2] = bytes(firmware)
        registers[3:5] = model.to_bytes(2, "little")
        registers[5] = servo
        registers[18] = 12
        registers[31:33] = (abs(homing) | (0x800 if homing < 0 else 0)).to_bytes(2, "little")
        registers[62:64] = bytes([121, 25])
        return registers

    @staticmethod
    def put_position(registers, position):
        registers[56:58] = (abs(position) | (0x8000 if position < 0 else 0)).to_bytes(2, "little")

    @staticmethod
    def put_homing(registers, homing):
        registers[31:33] = (abs(homing) | (0x800 if homing < 0 else 0)).to_bytes(2, "little")

    @staticmethod
    def requests(data):
        """(instruction, id, parameters), and what is left."""
        found = []
        while True:
            at = data.find(b"\xff\xff")
            if at < 0 or len(data) < at + 4 or len(data) < at + 4 + min(data[at + 3], 60):
                return found, data
            end = at + 4 + data[at + 3]
            body = data[at + 2 : end]
            if not 4 <= len(body) <= 62 or sum(body) & 0xFF != 0xFF:  # not for this family
                data = data[at + 1 :]
                continue
            data = data[end:]
            found.append((body[2], body[0], body[3:-1]))

    @staticmethod
    def span(params):
        return params[0], params[1], params[2:]

    @staticmethod
    def write(params):
        return params[0], params[1:]

    @staticmethod
    def pinged(registers):
        return b""

    @staticmethod
    def status(servo, error, data):
        body = bytes([servo, len(data) + 2, error]) + bytes(data)
        return b"\xff\xff" + body + bytes([~sum(body) & 0xFF])


class Dynamixel:
    kind = "dynamixel"
    position, temperature, torque, delay, model = 132, 146, 64, 9, 1060

    @staticmethod
    def table(servo, model=1060, homing=0, firmware=(45,)):
        registers = bytearray(1024)
        registers[0:2] = model.to_bytes(2, "little")
        registers[6], registers[7] = firmware[0], servo
        registers[9], registers[11] = 250, 3
        registers[20:24] = homing.to_bytes(4, "little", signed=True)
        registers[146] = 25
        return registers

    @staticmethod
    def put_position(registers, position):
        registers[132:136] = position.to_bytes(4, "little", signed=True)

    @staticmethod
    def put_homing(registers, homing):
        registers[20:24] = homing.to_bytes(4, "little", signed=True)

    @staticmethod
    def requests(data):
        found = []
        while True:
            at = data.find(b"\xff\xff\xfd\x00")
            if at < 0 or len(data) < at + 7:
                return found, data
            end = at + 7 + int.from_bytes(data[at + 5 : at + 7], "little")
            if len(data) < end:
                return found, data
            packet, data = data[at:end], data[end:]
            assert dxl_crc(packet[:-2]) == packet[-2:]
            found.append((packet[7], packet[4], packet[8:-2]))

    @staticmethod
    def span(params):
        return (
            int.from_bytes(params[0:2], "little"),
            int.from_bytes(params[2:4], "little"),
            params[4:],
        )

    @staticmethod
    def write(params):
        return int.from_bytes(params[:2], "little"), params[2:]

    @staticmethod
    def pinged(registers):
        return registers[0:2] + registers[6:7]

    @staticmethod
    def status(servo, error, data):
        body = stuffed(bytes([0x55, error]) + bytes(data))
        packet = b"\xff\xff\xfd\x00" + bytes([servo])
        packet += (len(body) + 2).to_bytes(2, "little") + body
        return packet + dxl_crc(packet)


class FakeServos(PtyLink):
    """`registers[id]` are the servos; `silent` ids do not answer; `motion(time)` → positions."""

    def __init__(self, family, folder, ids=(1, 2, 3), knows_fast=False, no_sync=(), **tables):
        self.family = family
        self.registers = {
            servo: family.table(servo, **{k: v.get(servo, v[0]) for k, v in tables.items()})
            for servo in ids
        }
        self.errors = dict.fromkeys(ids, 0)
        self.silent: set[int] = set()
        self.refuses: set[int] = set()  # addresses that are not written
        self.no_sync = set(no_sync)  # who answers a plain read alone
        self.deaf = False
        self.echo = False
        self.knows_fast = knows_fast
        self.break_chain_at: int | None = None
        self.spoils: dict[int, int] = {}  # bits that flip in a servo's position of a fast answer
        self.cycles: list[dict[int, int]] = []  # positions told, by cycle
        self.requests: list[tuple[int, int, bytes]] = []
        self.writes: list[tuple[int, int, bytes]] = []
        self.before_answers = None  # hook: (cycle, statuses) → statuses
        self.before_reading = None  # hook: (cycle), to move the joints
        self.before_request = None  # hook: (instruction, servo)
        self.before_answer = None  # hook, of a plain read: (servo, status) → statuses
        for servo in ids:
            family.put_position(self.registers[servo], 2048)
        super().__init__(folder / "servos")
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self._stop.set()
        self._thread.join()
        if self.master >= 0:
            self.unplug()

    def move(self, servo, position):
        self.family.put_position(self.registers[servo], position)

    def say(self, data):
        with suppress(OSError):
            os.write(self.master, data)

    def _run(self):
        data = b""
        while not self._stop.is_set():
            master = self.master
            if master < 0:
                self._stop.wait(0.005)
                continue
            try:
                if not select.select([master], [], [], 0.02)[0]:
                    continue
                new = os.read(master, 4096)
            except OSError:
                data = b""
                continue
            if self.echo:
                self.say(new)
            found, data = self.family.requests(data + new)
            for request in found:
                self.requests.append(request)
                if self.before_request:
                    self.before_request(*request[:2])
                if not self.deaf:
                    self._answer(*request)

    def _answer(self, instruction, servo, params):
        family = self.family
        if instruction == 0x03 and servo in self.registers:
            address, values = family.write(params)
            self.writes.append((servo, address, bytes(values)))
            if address not in self.refuses:
                self.registers[servo][address : address + len(values)] = values
            self.say(family.status(servo, self.errors[servo], b""))
        elif instruction == 0x01 and servo in self.registers.keys() - self.silent:
            self.say(family.status(servo, self.errors[servo], family.pinged(self.registers[servo])))
        elif instruction == 0x02 and servo in self.registers.keys() - self.silent:
            address, length, _ = family.span(params)
            is_cycle = address == family.position
            if is_cycle and servo == min(self.registers):
                if self.before_reading:
                    self.before_reading(len(self.cycles))
                self.cycles.append({})
            if is_cycle:
                self.cycles[-1][servo] = self._position(servo)
            data = self.registers[servo][address : address + length]
            statuses = [family.status(servo, self.errors[servo], data)]
            if is_cycle and self.before_answer:
                statuses = self.before_answer(servo, statuses[0])
            self.say(b"".join(statuses))
        elif instruction == 0x82 or (instruction == 0x8A and self.knows_fast):
            address, length, ids = family.span(params)
            cycle = address == family.position
            if cycle and self.before_reading:
                self.before_reading(len(self.cycles))
            there = [s for s in ids if s in self.registers.keys() - self.silent - self.no_sync]
            if instruction == 0x8A:
                self._answer_fast(ids, there, address, length)
                return
            if cycle:
                self.cycles.append({s: self._position(s) for s in there})
            statuses = [
                family.status(s, self.errors[s], self.registers[s][address : address + length])
                for s in there
            ]
            if self.before_answers and cycle:
                statuses = self.before_answers(len(self.cycles) - 1, statuses)
            self.say(b"".join(statuses))

    def _answer_fast(self, ids, there, address, length):
        size = 1 + len(ids) * (4 + length)
        data = b"\xff\xff\xfd\x00\xfe" + size.to_bytes(2, "little") + b"\x55"
        if address == self.family.position and set(ids) == set(there):
            self.cycles.append({s: self._position(s) for s in there})
        for servo in ids:
            if servo not in there or servo == self.break_chain_at:
                break
            block = bytes([self.errors[servo], servo])
            block += self.registers[servo][address : address + length]
            check = dxl_crc(data + block)
            # Later servos see what the line made of it, and their checksums hold for that.
            data += block[:2] + bytes([block[2] ^ self.spoils.get(servo, 0)]) + block[3:] + check
        self.say(data)

    def _position(self, servo):
        at, registers = self.family.position, self.registers[servo]
        if self.family is Feetech:
            value = int.from_bytes(registers[at : at + 2], "little")
            return -(value & 0x7FFF) if value & 0x8000 else value
        return int.from_bytes(registers[at : at + 4], "little", signed=True)
