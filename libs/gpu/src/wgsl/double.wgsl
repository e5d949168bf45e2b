// Double precision arithmetic with the results of the CPU, to the bit. It needs numbers of 64 bits.

fn wide(high: u32, low: u32) -> f64 {
    return bitcast<f64>((u64(high) << 32u) | u64(low));
}

// The quotient of finite numbers whose quotient is a normal number. That of the device is corrected by its integer
// residual modulo 2^64. Of other arguments the quotient is that of the device.
fn wide_div(a: f64, b: f64) -> f64 {
    let x = bitcast<u64>(a) & 0x7ffffffffffffffflu;
    let y = bitcast<u64>(b) & 0x7ffffffffffffffflu;
    let sign = (bitcast<u64>(a) ^ bitcast<u64>(b)) & 0x8000000000000000lu;
    let ex = u32(x >> 52u);
    let ey = u32(y >> 52u);
    if (ex == 0u || ey == 0u || ex == 2047u || ey == 2047u) {
        return a / b;
    }
    var m = (x & 0x000ffffffffffffflu) | 0x0010000000000000lu;
    let n = (y & 0x000ffffffffffffflu) | 0x0010000000000000lu;
    var e = i32(ex) - i32(ey);
    if (m < n) {
        m = m << 1u;
        e -= 1;
    }
    if (e < -1022 || e > 1022) {
        return a / b;
    }
    // The quotient in 55 bits: 53, and two for rounding.
    var q = u64((f64(m) / f64(n)) * 18014398509481984.0lf);
    var r = bitcast<i64>((m << 54u) - q * n);
    let step = i64(f64(r) / f64(n));
    q = bitcast<u64>(bitcast<i64>(q) + step);
    r = r - step * bitcast<i64>(n);
    if (r < 0li) {
        q -= 1lu;
        r += bitcast<i64>(n);
    }
    if (r >= bitcast<i64>(n)) {
        q += 1lu;
        r -= bitcast<i64>(n);
    }
    var kept = q >> 2u;
    let rest = q & 3lu;
    if (rest == 3lu || (rest == 2lu && (r != 0li || (kept & 1lu) == 1lu))) {
        kept += 1lu;
    }
    // The leading bit adds one to the exponent.
    return bitcast<f64>(sign | (kept + (u64(e + 1022) << 52u)));
}

fn power_of_two(k: i32) -> f32 {
    return bitcast<f32>(bitcast<u32>(k + 127) << 23u);
}

fn wide_nearest(x: f64) -> f64 {
    return (x + 6755399441055744.0lf) - 6755399441055744.0lf;
}

fn log2_of_mantissa(m32: f32) -> f64 {
    let m = f64(m32);
    let s = wide_div(m - 1.0lf, m + 1.0lf);
    let z = s * s;
    let p = ((((wide_div(z, 13.0lf) + 0.09090909090909091lf) * z + 0.1111111111111111lf) * z + 0.14285714285714285lf) * z
        + 0.2lf) * z + 0.3333333333333333lf;
    return 2.8853900817779268lf * (s + s * z * p);
}

fn log2_ordinary(x: f32) -> f32 {
    let t = parts(x);
    return t.exponent + f32(log2_of_mantissa(t.mantissa));
}

fn log10_ordinary(x: f32) -> f32 {
    let t = parts(x);
    return f32((f64(t.exponent) + log2_of_mantissa(t.mantissa)) * 0.3010299956639812lf);
}

fn exp_poly(r: f64) -> f64 {
    return 1.0lf + r * (1.0lf + r * (0.5lf + r * (0.16666666666666666lf + r * (0.041666666666666664lf
        + r * (0.008333333333333333lf + r * (0.001388888888888889lf + r * 0.0001984126984126984lf))))));
}

fn pow_ordinary(x: f32, y: f32) -> f32 {
    let t = parts(x);
    let v = (f64(t.exponent) + log2_of_mantissa(t.mantissa)) * f64(y);
    let k = wide_nearest(v);
    let r = (v - k) * 0.6931471805599453lf;
    return f32(exp_poly(r)) * power_of_two(i32(k));
}

fn exp_double(x: f64) -> f64 {
    let k = wide_nearest(x * 1.4426950408889634lf);
    let r = x - k * 0.6931471805599453lf;
    let whole = i32(k);
    let half = whole >> 1u;
    return exp_poly(r) * f64(power_of_two(half)) * f64(power_of_two(whole - half));
}

fn erfc_positive(x_in: f64) -> f64 {
    let x = select(x_in, 10.4lf, x_in > 10.4lf);
    let t = wide_div(1.0lf, 1.0lf + 0.5lf * x);
    var p = 0.0lf;
    p = p * t + -0.005421137600800485lf;
    p = p * t + 0.007124948478718964lf;
    p = p * t + 0.1109862602437485lf;
    p = p * t + -0.5118876399436642lf;
    p = p * t + 0.9924765993504742lf;
    p = p * t + -0.9871321850978898lf;
    p = p * t + 0.4999520509198028lf;
    p = p * t + -0.2291913548223597lf;
    p = p * t + 0.1461910837576967lf;
    p = p * t + 0.16454229806095394lf;
    p = p * t + 0.2482683413914522lf;
    p = p * t + 0.2819927405385626lf;
    p = p * t + 0.2820979946583245lf;
    return t * p * exp_double(-(x * x));
}

fn erf_of(x: f32) -> f32 {
    let y = f64(abs_of(x));
    let z = y * y;
    let near = y * (((((((-9.667044571486997e-6lf * z + 0.00011265959025606609lf) * z + -0.0008484080405535106lf) * z
        + 0.005221031807858023lf) * z + -0.026865430727670243lf) * z + 0.11283782495236845lf) * z
        + -0.3761263846802871lf) * z + 1.1283791670615434lf);
    let far = 1.0lf - erfc_positive(y);
    return copysign(f32(select(far, near, y < 1.0lf)), x);
}

fn erfc_of(x: f32) -> f32 {
    let tail = erfc_positive(f64(abs_of(x)));
    return f32(select(tail, 2.0lf - tail, x < 0.0f));
}
