// Single precision arithmetic with the results of the CPU, to the bit. Sums, differences and products are those of the
// device. `NoContraction` keeps them as they are written.

fn is_nan(x: f32) -> bool {
    return (bitcast<u32>(x) & 0x7fffffffu) > 0x7f800000u;
}

fn is_infinite(x: f32) -> bool {
    return (bitcast<u32>(x) & 0x7fffffffu) == 0x7f800000u;
}

fn is_finite(x: f32) -> bool {
    return (bitcast<u32>(x) & 0x7f800000u) != 0x7f800000u;
}

fn abs_of(x: f32) -> f32 {
    return bitcast<f32>(bitcast<u32>(x) & 0x7fffffffu);
}

fn neg(x: f32) -> f32 {
    return bitcast<f32>(bitcast<u32>(x) ^ 0x80000000u);
}

fn copysign(x: f32, sign: f32) -> f32 {
    return bitcast<f32>((bitcast<u32>(x) & 0x7fffffffu) | (bitcast<u32>(sign) & 0x80000000u));
}

// Comparisons by bits. They also order denormal numbers where the device flushes them.
fn order(x: f32) -> i32 {
    let b = bitcast<i32>(x);
    return select(b, bitcast<i32>(0x80000000u - bitcast<u32>(x)), b < 0);
}

fn is_less(a: f32, b: f32) -> bool {
    return order(a) < order(b) && !is_nan(a) && !is_nan(b);
}

fn min_of(a: f32, b: f32) -> f32 {
    return select(a, b, is_less(b, a));
}

fn max_of(a: f32, b: f32) -> f32 {
    return select(a, b, is_less(a, b));
}

// Rounds `v / 2^26 * 2^e` for `v` from 2^26 to 2^27, whose last bit stands for all later ones.
fn packed(sign: u32, e: i32, v: u32) -> f32 {
    if (e > 127) {
        return bitcast<f32>(sign | 0x7f800000u);
    }
    let is_normal = e >= -126;
    let shift = select(u32(min(3 - 126 - e, 31)), 3u, is_normal);
    let rest = v & ((1u << shift) - 1u);
    let half = 1u << (shift - 1u);
    var kept = v >> shift;
    if (rest > half || (rest == half && (kept & 1u) == 1u)) {
        kept += 1u;
    }
    // The leading bit of a normal number adds one to the exponent.
    let exponent = select(0u, u32(e + 126) << 23u, is_normal);
    return bitcast<f32>(sign | (kept + exponent));
}

// The quotient. That of the device is corrected by its integer residual modulo 2^32.
fn div(a: f32, b: f32) -> f32 {
    let x = bitcast<u32>(a) & 0x7fffffffu;
    let y = bitcast<u32>(b) & 0x7fffffffu;
    let sign = (bitcast<u32>(a) ^ bitcast<u32>(b)) & 0x80000000u;
    let infinite = 0x7f800000u;
    if (x > infinite || y > infinite || (x == 0u && y == 0u) || (x == infinite && y == infinite)) {
        return bitcast<f32>(0x7fc00000u | sign);
    }
    if (x == infinite || y == 0u) {
        return bitcast<f32>(sign | infinite);
    }
    if (y == infinite || x == 0u) {
        return bitcast<f32>(sign);
    }
    // Mantissas from 2^23 to 2^24, and exponents.
    let zeros_x = select(0u, countLeadingZeros(x) - 8u, x < 0x00800000u);
    let zeros_y = select(0u, countLeadingZeros(y) - 8u, y < 0x00800000u);
    var m = select((x & 0x007fffffu) | 0x00800000u, x << zeros_x, x < 0x00800000u);
    let n = select((y & 0x007fffffu) | 0x00800000u, y << zeros_y, y < 0x00800000u);
    var e = max(i32(x >> 23u), 1) - i32(zeros_x) - max(i32(y >> 23u), 1) + i32(zeros_y);
    if (m < n) {
        m = m << 1u;
        e -= 1;
    }
    // The quotient in 26 bits, and its residual.
    var q = u32((f32(m) / f32(n)) * 33554432.0f);
    var r = bitcast<i32>((m << 25u) - q * n);
    let step = i32(floor(f32(r) / f32(n)));
    q = bitcast<u32>(bitcast<i32>(q) + step);
    r = r - step * bitcast<i32>(n);
    if (r < 0) {
        q -= 1u;
        r += bitcast<i32>(n);
    }
    if (r >= bitcast<i32>(n)) {
        q += 1u;
        r -= bitcast<i32>(n);
    }
    return packed(sign, e, (q << 1u) | select(0u, 1u, r != 0));
}

// The square root, corrected as the quotient is.
fn root(a: f32) -> f32 {
    let x = bitcast<u32>(a);
    if ((x & 0x7fffffffu) == 0u || x == 0x7f800000u) {
        return a;
    }
    if (x > 0x7f800000u) {
        return bitcast<f32>(0x7fc00000u);
    }
    let zeros = select(0u, countLeadingZeros(x) - 8u, x < 0x00800000u);
    var m = select((x & 0x007fffffu) | 0x00800000u, x << zeros, x < 0x00800000u) << 1u;
    var e = max(i32(x >> 23u), 1) - i32(zeros) - 127;
    if ((e & 1) != 0) {
        m = m << 1u;
        e -= 1;
    }
    // The root of m * 2^24, which has 25 bits, and its residual.
    var s = u32(sqrt(f32(m)) * 4096.0f);
    var r = bitcast<i32>((m << 24u) - s * s);
    s = bitcast<u32>(bitcast<i32>(s) + i32(floor(f32(r) / (2.0f * f32(s)))));
    r = bitcast<i32>((m << 24u) - s * s);
    if (r < 0) {
        s -= 1u;
        r += bitcast<i32>(2u * s + 1u);
    }
    if (r > bitcast<i32>(2u * s)) {
        r -= bitcast<i32>(2u * s + 1u);
        s += 1u;
    }
    return packed(0u, e >> 1u, (s << 2u) | select(0u, 1u, r != 0));
}

// The largest whole number that is not larger.
fn floor_of(x: f32) -> f32 {
    let a = abs_of(x);
    if (!(a < 8388608.0f)) {
        return x;
    }
    let whole = f32(i32(a));
    if (bitcast<u32>(x) < 0x80000000u) {
        return whole;
    }
    return neg(whole + select(0.0f, 1.0f, whole != a || (whole == 0.0f && bitcast<u32>(a) != 0u)));
}

fn ceil_of(x: f32) -> f32 {
    return neg(floor_of(neg(x)));
}

fn trunc_of(x: f32) -> f32 {
    return copysign(floor_of(abs_of(x)), x);
}

// The nearest whole number; that away from zero of two.
fn round_of(x: f32) -> f32 {
    let whole = trunc_of(x);
    let rest = abs_of(x - whole);
    return select(whole, copysign(abs_of(whole) + 1.0f, x), rest >= 0.5f);
}

fn modulo(p: f32, q: f32) -> f32 {
    return p - q * floor_of(div(p, q));
}

fn clamp_to(x: f32, low: f32, high: f32) -> f32 {
    let above = select(x, low, is_less(x, low));
    return select(above, high, is_less(high, above));
}

fn mix_of(x: f32, y: f32, t: f32) -> f32 {
    return x * (1.0f - t) + y * t;
}

fn smoothstep_of(e0: f32, e1: f32, x: f32) -> f32 {
    let t = div(x - e0, e1 - e0);
    let middle = t * t * (3.0f - 2.0f * t);
    let below = select(middle, 1.0f, x >= e1);
    return select(below, 0.0f, x <= e0);
}

// The polynomials of the CPU, operation by operation.

fn nearest(x: f32) -> f32 {
    return (x + 12582912.0f) - 12582912.0f;
}

struct Turns {
    quarters: i32,
    rest: f32,
}

fn turns(x: f32) -> Turns {
    let k = nearest(x * 0.636619772f);
    let r = ((x - k * 1.5703125f) - k * 4.837513e-4f) - k * 7.54979e-8f;
    return Turns(i32(k), r);
}

fn sin_poly(x: f32) -> f32 {
    let z = x * x;
    return ((-1.9515296e-4f * z + 8.332161e-3f) * z - 1.6666655e-1f) * z * x + x;
}

fn cos_poly(x: f32) -> f32 {
    let z = x * x;
    return ((2.4433157e-5f * z - 1.3887316e-3f) * z + 4.1666646e-2f) * z * z - 0.5f * z + 1.0f;
}

fn sin_near(x: f32) -> f32 {
    let t = turns(x);
    let v = select(cos_poly(t.rest), sin_poly(t.rest), (t.quarters & 1) == 0);
    let signed = select(neg(v), v, (t.quarters & 2) == 0);
    return select(signed, x, (bitcast<u32>(x) << 1u) == 0u);
}

fn cos_near(x: f32) -> f32 {
    let t = turns(x);
    let v = select(sin_poly(t.rest), cos_poly(t.rest), (t.quarters & 1) == 0);
    return select(neg(v), v, ((t.quarters + 1) & 2) == 0);
}

fn tan_near(x: f32) -> f32 {
    let t = turns(x);
    let r = t.rest;
    let z = r * r;
    let p = (((((9.385402e-3f * z + 3.1199223e-3f) * z + 2.4430135e-2f) * z + 5.341128e-2f) * z + 1.3338799e-1f) * z
        + 3.3333157e-1f) * z * r + r;
    let v = select(div(-1.0f, p), p, (t.quarters & 1) == 0);
    return select(v, x, (bitcast<u32>(x) << 1u) == 0u);
}

fn asin_poly(z: f32, s: f32) -> f32 {
    return ((((4.21632e-2f * z + 2.418131e-2f) * z + 4.5470026e-2f) * z + 7.4953003e-2f) * z + 1.6666752e-1f) * z * s
        + s;
}

fn asin_inside(x: f32) -> f32 {
    let a = abs_of(x);
    let far = a > 0.5f;
    let z = select(a * a, 0.5f * (1.0f - a), far);
    let p = asin_poly(z, select(a, root(z), far));
    return copysign(select(p, 1.57079633f - 2.0f * p, far), x);
}

fn acos_inside(x: f32) -> f32 {
    let a = abs_of(x);
    let far = a > 0.5f;
    let z = select(a * a, 0.5f * (1.0f - a), far);
    let p = asin_poly(z, select(a, root(z), far));
    let near = 1.57079633f - copysign(p, x);
    return select(near, select(2.0f * p, 3.14159265f - 2.0f * p, x < 0.0f), far);
}

fn atan_of(x: f32) -> f32 {
    let a = abs_of(x);
    let far = a > 2.4142136f;
    let mid = a > 0.41421357f;
    let base = select(select(0.0f, 0.785398163f, mid), 1.57079633f, far);
    let r = select(select(a, div(a - 1.0f, a + 1.0f), mid), div(-1.0f, a), far);
    let z = r * r;
    let p = (((8.0537445e-2f * z - 1.3877686e-1f) * z + 1.9977711e-1f) * z - 3.333295e-1f) * z * r + r;
    return copysign(base + p, x);
}

fn atan2_plain(y: f32, x: f32) -> f32 {
    let a = atan_of(div(abs_of(y), abs_of(x)));
    return copysign(select(a, 3.14159265f - a, x < 0.0f), y);
}

fn exp_near(x: f32) -> f32 {
    let k = nearest(x * 1.44269504f);
    let r = (x - k * 0.6933594f) + k * 2.1219444e-4f;
    let p = ((((1.9875691e-4f * r + 1.3981999e-3f) * r + 8.333452e-3f) * r + 4.1665796e-2f) * r + 1.6666665e-1f) * r
        + 0.5f;
    let y = p * r * r + r + 1.0f;
    return y * bitcast<f32>(bitcast<u32>(i32(k) + 127) << 23u);
}

fn tanh_of(x: f32) -> f32 {
    let a = abs_of(x);
    let z = x * x;
    let p = ((((-5.7049887e-3f * z + 2.063909e-2f) * z - 5.3739716e-2f) * z + 1.3331442e-1f) * z - 3.333328e-1f) * z * x
        + x;
    let far = 1.0f - div(2.0f, exp_near(select(a + a, 19.0f, a > 9.5f)) + 1.0f);
    return select(copysign(far, x), p, a < 0.625f);
}

fn sinh_near(x: f32) -> f32 {
    let z = x * x;
    let p = ((2.0372191e-4f * z + 8.330284e-3f) * z + 1.6666716e-1f) * z * x + x;
    let e = exp_near(abs_of(x));
    return select(copysign(0.5f * e - div(0.5f, e), x), p, abs_of(x) <= 1.0f);
}

fn cosh_near(x: f32) -> f32 {
    let e = exp_near(abs_of(x));
    return 0.5f * e + div(0.5f, e);
}

struct Parts {
    exponent: f32,
    mantissa: f32,
}

// The exponent, and a mantissa from the root of 1/2 to that of 2.
fn parts(x: f32) -> Parts {
    let bits = bitcast<u32>(x);
    let e = f32(i32((bits >> 23u) & 0xffu) - 126);
    let m = bitcast<f32>((bits & 0x007fffffu) | 0x3f000000u);
    let small = m < 0.707106781f;
    return Parts(e - select(0.0f, 1.0f, small), select(m, m + m, small));
}

fn ln_ordinary(x: f32) -> f32 {
    let t = parts(x);
    let r = t.mantissa - 1.0f;
    let z = r * r;
    let p = ((((((((7.0376836e-2f * r - 1.151461e-1f) * r + 1.1676999e-1f) * r - 1.2420141e-1f) * r + 1.4249323e-1f) * r
        - 1.6668058e-1f) * r + 2.0000715e-1f) * r - 2.4999994e-1f) * r + 3.333333e-1f) * r * z;
    return (p + t.exponent * -2.1219444e-4f - 0.5f * z) + r + t.exponent * 0.6933594f;
}
