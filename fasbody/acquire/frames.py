"""The binary wire format: COBS frames, each with two CRC-16. docs/acquisition.md describes it for firmware.

One CRC-16 lets one damaged frame in 65 536 pass. On a bad line that is a wrong sample every few minutes, so a frame
carries two with different polynomials, which together miss one in 2^31.
"""

import binascii
import math
import struct

import numpy as np

from fasbody.acquire.messages import ROLES, Block, Channel, Damage, Hello, Message
from fasbody.acquire.pieces import PieceReader
from fasbody.exceptions import MissingPackageError

try:
    from cobs import cobs
except ImportError:  # the extra is not installed
    raise MissingPackageError("cobs", "acquire") from None

VERSION = 1
#: Longest payload and longest frame on the wire [bytes]; what is longer is damage, so memory stays bounded.
LONGEST = 1024
LONGEST_WIRE = LONGEST + 4 + 6
LARGEST_BOARD_NAME = 32
OVER_RANGE = 1
_HELLO, _DATA = ord("H"), ord("D")
_HELLO_HEAD, _CHANNEL, _DATA_HEAD = struct.Struct("<BBBBHIH"), struct.Struct("<Bff"), struct.Struct("<BBII")


def _table() -> list[int]:
    out = []
    for byte in range(256):
        crc = byte
        for _ in range(8):
            crc = (crc >> 1) ^ 0xA001 if crc & 1 else crc >> 1
        out.append(crc)
    return out


_MODBUS = _table()


def crc_ccitt(data: bytes) -> int:
    """CRC-16/CCITT-FALSE: polynomial 0x1021, start 0xFFFF; of b"123456789" it is 0x29B1."""
    return binascii.crc_hqx(data, 0xFFFF)


def crc_modbus(data: bytes) -> int:
    """CRC-16/MODBUS: polynomial 0x8005 reflected, start 0xFFFF; of b"123456789" it is 0x4B37."""
    crc = 0xFFFF
    for byte in data:
        crc = (crc >> 8) ^ _MODBUS[(crc ^ byte) & 0xFF]
    return crc


def _checks(payload: bytes) -> bytes:
    return struct.pack("<HH", crc_ccitt(payload), crc_modbus(payload))


def wrap(payload: bytes) -> bytes:
    """A payload as it goes over the wire: with both CRCs, stuffed, between two zero bytes.

    The first zero keeps a frame readable whose predecessor lost its last one.
    """
    return b"\0" + cobs.encode(payload + _checks(payload)) + b"\0"


def encode_hello(hello: Hello) -> bytes:
    """The hello frame."""
    head = _HELLO_HEAD.pack(
        _HELLO, VERSION, hello.bits, len(hello.channels), hello.frame_samples, round(1000 * hello.rate_hz), hello.boot
    )
    body = b"".join(_CHANNEL.pack(ROLES.index(c.role), c.range_m_s2, c.counts_per_m_s2) for c in hello.channels)
    return wrap(head + body + hello.board.encode()[:LARGEST_BOARD_NAME])


def encode_data(sequence: int, time_us: int, counts: np.ndarray, bits: int, flags: int = 0) -> bytes:
    """A data frame of counts (n, channels)."""
    head = _DATA_HEAD.pack(_DATA, flags, sequence % 2**32, time_us % 2**32)
    if bits == 16:
        return wrap(head + counts.astype("<i2").tobytes())
    wide = counts.astype("<i4").reshape(-1, 1).view(np.uint8)
    return wrap(head + wide[:, :3].tobytes())


class FrameReader(PieceReader):
    """Reads binary frames."""

    END, LONGEST = b"\0", LONGEST_WIRE

    def read(self, piece: bytes) -> Message | None:
        """One frame; None for data before the first hello."""
        try:
            raw = cobs.decode(piece)
        except cobs.DecodeError:
            return Damage("COBS", len(piece))
        payload = raw[:-4]
        if len(payload) < 2 or raw[-4:] != _checks(payload):
            return Damage("CRC", len(piece))
        if payload[0] == _HELLO:
            hello = _read_hello(payload)
            if hello is None:
                return Damage("hello not understood", len(piece))
            self.hello, self.preamble = hello, piece + b"\0"
            return hello
        if payload[0] != _DATA:
            return Damage("unknown type", len(piece))
        if self.hello is None:
            return None
        return _read_data(payload, self.hello) or Damage("length", len(piece))


def _read_hello(payload: bytes) -> Hello | None:
    if len(payload) < _HELLO_HEAD.size:
        return None
    _, version, bits, count, frame_samples, rate, boot = _HELLO_HEAD.unpack_from(payload)
    end = _HELLO_HEAD.size + count * _CHANNEL.size
    sound = version == VERSION and bits in (16, 24) and 1 <= count <= 16 and frame_samples and rate
    if not sound or end > len(payload) or len(payload) - end > LARGEST_BOARD_NAME:
        return None
    channels = []
    for role, span, sensitivity in _CHANNEL.iter_unpack(payload[_HELLO_HEAD.size : end]):
        if not (role < len(ROLES) and 0 < span < math.inf and 0 < abs(sensitivity) < math.inf):
            return None
        channels.append(Channel(ROLES[role], span, sensitivity))
    board = payload[end:].decode(errors="replace")
    return Hello(board, rate / 1000, tuple(channels), bits, frame_samples, boot)


def _read_data(payload: bytes, hello: Hello) -> Block | None:
    """Samples of a data frame; None if its length is not the one that the hello frame promised."""
    width, count = hello.bits // 8, hello.frame_samples * len(hello.channels)
    if len(payload) != _DATA_HEAD.size + width * count:
        return None
    _, flags, sequence, time_us = _DATA_HEAD.unpack_from(payload)
    if width == 2:
        counts = np.frombuffer(payload, "<i2", offset=_DATA_HEAD.size).astype(np.int32)
    else:
        raw = np.frombuffer(payload, np.uint8, offset=_DATA_HEAD.size).reshape(-1, 3)
        wide = np.zeros((count, 4), np.uint8)
        wide[:, 1:] = raw
        counts = wide.view("<i4").ravel() >> 8  # the shift brings the sign down
    counts = counts.reshape(hello.frame_samples, -1)
    samples = counts / np.array([c.counts_per_m_s2 for c in hello.channels])
    rail = 2 ** (hello.bits - 1)
    over = (hello.beyond(samples) | (counts >= rail - 1) | (counts <= -rail)).sum(axis=0)
    if flags & OVER_RANGE:
        over = np.maximum(over, 1)
    return Block(sequence, time_us, samples, over)
