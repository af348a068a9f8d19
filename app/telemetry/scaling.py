"""Raw counts as quantities: the bits of a word, a scale and an offset.

Bit 1 is the least significant one, as ARINC 429 numbers its words.
"""

import re
from dataclasses import dataclass
from functools import cache
from math import isfinite

import numpy as np

from app.telemetry.recording import TelemetryError
from core.types import Array

COUNTS = "counts"
"""Unit of raw counts whose scale is not known."""
MOST_BITS = 52
"""A number in double precision holds no more of them exactly."""
BITS = re.compile(r"(\d{1,3})(?: *(?:-|to) *(\d{1,3}))?(?: +(signed|bnr|bcd))?", re.IGNORECASE)
STATUS = 29
"""Bits of an ARINC 429 word below its sign and status matrix, bits 30 and 31."""
NORMAL, MINUS, PLUS = 3, 3, 0
"""Sign and status of a BNR word in normal operation; of a negative and of a positive BCD word."""


@dataclass(frozen=True)
class BitField:
    """Bits `low` to `high` of a word.

    kind: "" for a number without sign, "signed" for two's complement, "bnr" for that in an
    ARINC 429 word, missing unless its status is normal operation, "bcd" for decimal digits of four
    bits, with the sign of an ARINC 429 word, missing if its status is no computed data or a test.
    """

    low: int
    high: int
    kind: str = ""

    def of(self, words: Array) -> Array:
        """The field of each word (n,). A negative word is in two's complement.

        NaN unless it is a whole number of at most MOST_BITS bits.
        """
        is_word = (words == np.round(words)) & (np.abs(words) < 2.0**MOST_BITS)
        whole = np.where(is_word, words, 0.0).astype(np.int64)
        n_bits = self.high - self.low + 1
        field = whole >> self.low - 1 & (1 << n_bits) - 1
        status = np.where(whole < 0, PLUS, whole >> STATUS & 3)  # a negative word is shorter
        if self.kind in ("signed", "bnr"):
            field -= (field >> n_bits - 1) << n_bits
        if self.kind == "bnr":
            is_word &= status == NORMAL
        if self.kind == "bcd":
            digits = [field >> at & 15 for at in range(0, n_bits, 4)]
            is_word &= np.all([digit < 10 for digit in digits], axis=0)
            is_word &= (status == PLUS) | (status == MINUS)
            field = sum((digit * 10**place for place, digit in enumerate(digits)), 0 * field)
            field = np.where(status == MINUS, -field, field)
        return np.where(is_word, field, np.nan)

    def why_missing(self, words: Array) -> str:
        """Why none of the words (n,) has a value; "" if any has one, or none was recorded."""
        known = np.isfinite(words)
        if not known.any() or np.isfinite(self.of(words)).any():
            return ""
        if self.kind == "bnr":
            return f"no sample's status (bits {STATUS + 1} and {STATUS + 2}) is normal operation"
        return "no sample has decimal digits and a valid status" if self.kind == "bcd" else ""


def has_fractions(raw: Array) -> bool:
    known = raw[np.isfinite(raw)]
    return bool((known != np.round(known)).any())


@cache
def read_bits(text: str) -> BitField:
    """Read "5-16", "5-16 signed", "11-29 bnr", "11-29 bcd" or "7". TelemetryError."""
    match = BITS.fullmatch(text.strip())
    if match is None:
        raise TelemetryError(
            f"{text!r} does not name bits: write 5-16, 5-16 signed, 11-29 bnr, 11-29 bcd or 7; "
            "bit 1 is the least significant"
        )
    low = int(match[1])
    high = int(match[2] or low)
    if not 1 <= low <= high <= MOST_BITS:
        raise TelemetryError(
            f"bits {text!r} do not rise within 1 to {MOST_BITS}: give the least significant first"
        )
    return BitField(low, high, (match[3] or "").lower())


@dataclass(frozen=True)
class Scaling:
    """value = scale * raw + offset.   bits: of the raw word, "" for the whole number."""

    scale: float = 1.0
    offset: float = 0.0
    bits: str = ""

    def __call__(self, raw: Array) -> Array:
        """Values of raw numbers (n,); the same array if nothing changes. TelemetryError."""
        values = read_bits(self.bits).of(raw) if self.bits else raw
        if self.scale != 1.0:
            values = values * self.scale
        return values + self.offset if self.offset else values

    def problem(self) -> str:
        """The fault in words, "" if valid."""
        if not (isfinite(self.scale) and self.scale):
            return f"has a scale of {self.scale:g}: give a finite number other than zero"
        if not isfinite(self.offset):
            return f"has an offset of {self.offset:g}: give a finite number"
        try:
            read_bits(self.bits or "1")
        except TelemetryError as error:
            return f"has wrong bits: {error}"
        return ""

    def __str__(self) -> str:
        """In words: "0.0055 * bits 5-16 signed - 180"; "" if nothing changes."""
        raw = f"bits {self.bits}" if self.bits else "raw"
        scaled = raw if self.scale == 1.0 else f"{self.scale:.10g} * {raw}"
        if self.offset:
            return f"{scaled} {'-' if self.offset < 0 else '+'} {abs(self.offset):.10g}"
        return "" if scaled == "raw" else scaled


AS_RECORDED = Scaling()
