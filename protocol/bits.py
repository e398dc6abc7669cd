"""Numbers as few bits: writing and reading a string of bits, most significant first."""

import numpy as np

from protocol.arrays import Ints
from protocol.errors import ProtocolError

MAX_PREFIX = 28  # zeros before an exponential-Golomb number; a larger number stands in no map (ours)


def folded(value: int) -> int:
    """0, -1, 1, -2, ... as 0, 1, 2, 3, ..."""
    return 2 * value if value >= 0 else -2 * value - 1


def bits_of(value: int, k: int) -> int:
    """Bits that a number >= 0 takes in exponential-Golomb code of order k."""
    return 2 * (value + (1 << k)).bit_length() - 1 - k


def bits_of_each(values: Ints, k: Ints | int) -> Ints:
    """The same of many numbers, and orders."""
    lengths = np.frexp(values + 2.0**k)[1]  # as int.bit_length tells them
    return np.asarray(2 * lengths - 1 - k, np.int64)


def packed(values: Ints, counts: Ints) -> bytes:
    """The lowest bits of values (n,) >= 0, as many of each as counts (n,) says; the last byte is filled with zeros."""
    bits = np.unpackbits(values.astype(">u8").view(np.uint8).reshape(-1, 8), axis=1)
    return np.packbits(bits[np.arange(64) >= 64 - counts[:, None]]).tobytes()


class BitWriter:
    """Collects bits."""

    def __init__(self) -> None:
        self._digits: list[str] = []

    def bits(self, value: int, count: int) -> None:
        """Append the `count` lowest bits of a value >= 0."""
        if count:
            self._digits.append(format(value & ((1 << count) - 1), f"0{count}b"))

    def number(self, value: int, k: int = 0) -> None:
        """Append a number >= 0 in exponential-Golomb code of order k, which is shortest below 2**k."""
        self.bits(value + (1 << k), bits_of(value, k))

    def signed(self, value: int, k: int = 0) -> None:
        """Append a number of any sign."""
        self.number(folded(value), k)

    def data(self) -> bytes:
        """All bits, the last byte filled up with zeros."""
        digits = "".join(self._digits)
        size = len(digits) + 7 >> 3
        return int(digits.ljust(8 * size, "0") or "0", 2).to_bytes(size)


class BitReader:
    """Takes bits, and raises ProtocolError where there are no more."""

    def __init__(self, data: bytes) -> None:
        self._digits = format(int.from_bytes(data), f"0{8 * len(data)}b") if data else ""
        self._at = 0

    def bits(self, count: int) -> int:
        """The next `count` bits."""
        first, end = self._at, self._at + count
        if end > len(self._digits):
            raise ProtocolError("a message ends in the middle of a number")
        self._at = end
        return int(self._digits[first:end], 2) if count else 0

    def number(self, k: int = 0) -> int:
        """A number as `BitWriter.number` writes it."""
        one = self._digits.find("1", self._at, self._at + MAX_PREFIX + 1)
        if one < 0:
            self.bits(MAX_PREFIX + 1)  # raises where the message ends
            raise ProtocolError("a number in a message is too large")
        zeros, self._at = one - self._at, one
        return self.bits(1 + zeros + k) - (1 << k)

    def signed(self, k: int = 0) -> int:
        """A number as `BitWriter.signed` writes it."""
        value = self.number(k)
        return value >> 1 if value % 2 == 0 else -(value + 1 >> 1)

    def finish(self) -> None:
        """Raise ProtocolError unless only the zeros are left that fill the last byte."""
        left = len(self._digits) - self._at
        if left >= 8 or self.bits(left):
            raise ProtocolError("a message is followed by bytes that do not belong to it")
