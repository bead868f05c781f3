"""Numbers of twice the digits: unevaluated sums of two float64 numbers, 32 digits.

    x = high + low,   |low| <= half a rounding of high

A sum or product of two float64 numbers is such a pair *exactly*:

    a + b = s + ((a - (s - b')) + (b - b')),         s = fl(a + b),  b' = fl(s - a)
    a * b = p + (((a1 b1 - p) + a1 b2 + a2 b1) + a2 b2),   p = fl(a b),  a = a1 + a2 in halves

It is for the few values whose formula cancels more digits than float64 holds: an operation costs
10 to 40 plain ones. Gradients are those of the plain operations: the corrections are identically
zero as real functions, and so are their derivatives.

References: T. J. Dekker, "A floating-point technique for extending the available precision",
Numer. Math. 18 (1971); D. E. Knuth, *The Art of Computer Programming* 2, 4.2.2, theorem B; Y. Hida,
X. S. Li and D. H. Bailey, "Algorithms for Quad-Double Precision Floating Point Arithmetic",
ARITH-15 (2001).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from fractions import Fraction
from typing import TYPE_CHECKING, NamedTuple

import torch
from torch import Tensor

from torchradiometry.numerics import safe_sqrt

if TYPE_CHECKING:
    from jaxtyping import Bool, Float

__all__ = ["Double", "angle", "cross", "difference", "inner", "power_of_two", "product"]

#: 2^27 + 1 cuts the 53 bits of a float64 number into halves of 26 (Dekker 1971)
_SPLITTER = 2.0**27 + 1
#: the angle is halved so often, to below pi / 128, before its series is taken
_HALVINGS = 7
#: asin(s)/s = sum_k a_k s^(2k); at pi/128 the terms below leave less than 1e-33
_ARC = [
    Fraction(math.factorial(2 * k), 4**k * math.factorial(k) ** 2 * (2 * k + 1)) for k in range(10)
]


class Double(NamedTuple):
    """high + low; arithmetic by the operators, broadcasting as tensors do."""

    high: Float[Tensor, "..."]
    low: Float[Tensor, "..."]

    @classmethod
    def of(cls, value: Tensor) -> Double:
        """The number itself."""
        return cls(value, torch.zeros_like(value))

    @property
    def value(self) -> Float[Tensor, "..."]:
        """Rounded to float64."""
        return self.high + self.low

    def plus(self, other: Double) -> Double:
        """self + other."""
        high, rest = _two_sum(self.high, other.high)
        low, tail = _two_sum(self.low, other.low)
        high, rest = _fast_two_sum(high, rest + low)
        return Double(*_fast_two_sum(high, rest + tail))

    def minus(self, other: Double) -> Double:
        """self - other."""
        return self.plus(Double(-other.high, -other.low))

    def times(self, other: Double) -> Double:
        """self * other."""
        high, rest = _two_product(self.high, other.high)
        return Double(*_fast_two_sum(high, rest + (self.high * other.low + self.low * other.high)))

    def over(self, other: Double) -> Double:
        """self / other; other must not be 0."""
        first = self.high / other.high
        rest = self.minus(other.times(Double.of(first)))
        second = rest.high / other.high
        rest = rest.minus(other.times(Double.of(second)))
        high, low = _fast_two_sum(first, second)
        return Double(*_fast_two_sum(high, low + rest.high / other.high))

    def root(self) -> Double:
        """Square root, 0 with gradient 0 at values <= 0."""
        first = safe_sqrt(self.high)
        positive = first > 0
        safe = torch.where(positive, first, 1)
        rest = self.minus(Double(*_two_product(first, first)))
        return Double(*_fast_two_sum(first, torch.where(positive, rest.high / (2 * safe), 0)))

    def scaled(self, power: float) -> Double:
        """Times a power of two, exactly."""
        return Double(self.high * power, self.low * power)

    def apply(self, function: Callable[[Tensor], Tensor]) -> Double:
        """A rearrangement of the numbers, such as an index, of both parts."""
        return Double(function(self.high), function(self.low))

    def where(self, condition: Bool[Tensor, "..."], other: Double) -> Double:
        """self where the condition holds, other elsewhere."""
        high = torch.where(condition, self.high, other.high)
        return Double(high, torch.where(condition, self.low, other.low))

    def total(self, axis: int) -> Double:
        """Sum over an axis."""
        parts = zip(self.high.unbind(axis), self.low.unbind(axis), strict=True)
        found = Double(*next(parts))
        for part in parts:
            found = found.plus(Double(*part))
        return found


def difference(a: Float[Tensor, "..."], b: Float[Tensor, "..."]) -> Double:
    """a - b of float64 numbers, exactly.

    >>> one, small = torch.ones(1).double(), torch.full((1,), 2.0**-80).double()
    >>> gap = difference(one, small)
    >>> gap.high.item(), gap.low.item() == -(2.0**-80)
    (1.0, True)
    """
    return Double(*_two_sum(a, -b))


def product(a: Float[Tensor, "..."], b: Float[Tensor, "..."]) -> Double:
    """a * b of float64 numbers, exactly (but for underflow)."""
    return Double(*_two_product(*torch.broadcast_tensors(a, b)))


def power_of_two(extent: Float[Tensor, "..."]) -> Float[Tensor, "..."]:
    """The power of two at or below a positive extent, 1 for 0: a unit that rounds nothing.

    >>> power_of_two(torch.tensor([3.0, 0.25, 0.0]))
    tensor([2.0000, 0.2500, 1.0000])
    """
    extent = extent.detach()
    usable = (extent > 0) & torch.isfinite(extent)
    return torch.exp2(torch.floor(torch.log2(torch.where(usable, extent, 1))))


def inner(a: Double, b: Double) -> Double:
    """Inner product over the first axis."""
    return a.times(b).total(0)


def cross(a: Double, b: Double) -> Double:
    """Vector product over the first axis."""
    after, before = (lambda t: t.roll(-1, 0)), (lambda t: t.roll(-2, 0))
    first = a.apply(after).times(b.apply(before))
    return first.minus(a.apply(before).times(b.apply(after)))


def angle(sine: Double, cosine: Double) -> Double:
    """atan2(sine, cosine) for sine >= 0, radians; both may have a common factor.

    The direction is halved seven times by square roots, then asin's series is summed. 0 with
    gradient 0 where both are 0.
    """
    length = sine.times(sine).plus(cosine.times(cosine)).root()
    one = Double.of(torch.ones_like(length.high))
    defined = length.high > 0
    length = length.where(defined, one)
    sine, cosine = sine.over(length), cosine.where(defined, one).over(length)
    for _ in range(_HALVINGS):
        obtuse = cosine.high < 0
        # the larger of the two by its root, the other from it: neither cancels
        turned = Double(-cosine.high, -cosine.low).where(obtuse, cosine)
        larger = one.plus(turned).scaled(0.5).root()
        smaller = sine.over(larger).scaled(0.5)
        sine, cosine = larger.where(obtuse, smaller), smaller.where(obtuse, larger)
    square, series = sine.times(sine), _constant(_ARC[-1], sine.high)
    for term in reversed(_ARC[:-1]):
        series = series.times(square).plus(_constant(term, sine.high))
    return sine.times(series).scaled(2.0**_HALVINGS)


def _constant(value: Fraction, like: Tensor) -> Double:
    high = float(value)
    low = float(value - Fraction(high))
    return Double(torch.full_like(like, high), torch.full_like(like, low))


def _two_sum(a: Tensor, b: Tensor) -> tuple[Tensor, Tensor]:
    """Knuth's: the rounded sum and its error, for any a and b."""
    total = a + b
    taken = total - a
    return total, (a - (total - taken)) + (b - taken)


def _fast_two_sum(a: Tensor, b: Tensor) -> tuple[Tensor, Tensor]:
    """Dekker's: the same for |a| >= |b|."""
    total = a + b
    return total, b - (total - a)


def _two_product(a: Tensor, b: Tensor) -> tuple[Tensor, Tensor]:
    """Dekker's: the rounded product and its error."""
    whole = a * b
    (a1, a2), (b1, b2) = _halves(a), _halves(b)
    return whole, ((a1 * b1 - whole) + a1 * b2 + a2 * b1) + a2 * b2


def _halves(a: Tensor) -> tuple[Tensor, Tensor]:
    # a tensor: the ONNX exporter would round a Python number to float32
    large = torch.tensor(_SPLITTER, dtype=a.dtype, device=a.device) * a
    first = large - (large - a)
    return first, a - first
