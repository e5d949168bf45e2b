/* The functions of shaders, as `run/approx.rs` and `run/lanes.rs` define them: the same operations in the same order. A
 * function whose name ends with _near is right where the condition before it holds; other lanes count as bad. */
typedef int i32;
typedef unsigned u32;

#define ABS __builtin_fabsf
#define COPYSIGN __builtin_copysignf
#define SQRT __builtin_sqrtf

static inline float of_bits(u32 bits) { float f; __builtin_memcpy(&f, &bits, 4); return f; }
static inline u32 to_bits(float f) { u32 bits; __builtin_memcpy(&bits, &f, 4); return bits; }
/* Numbers that no int holds become 0. */
static inline i32 to_int(float k) { return (i32)(ABS(k) < 1e9f ? k : 0.0f); }
static inline i32 to_int_d(double k) { return (i32)(__builtin_fabs(k) < 1e9 ? k : 0.0); }
static inline float power_of_two(i32 k) { return of_bits(((u32)k + 127u) << 23); }
static inline float nearest(float x) { return (x + 12582912.0f) - 12582912.0f; }

static inline float round_(float x) {
  float t = __builtin_truncf(x);
  return ABS(x - t) >= 0.5f ? t + COPYSIGN(1.0f, x) : t;
}

static inline int turns_are_few(float x) { return ABS(x) <= 8192.0f; }
static inline float quarter(float x, i32 *k) {
  float n = nearest(x * 0x1.45f306p-1f);
  *k = to_int(n);
  return ((x - n * 1.5703125f) - n * 4.837513e-4f) - n * 7.54979e-8f;
}
static inline float sin_poly(float x) {
  float z = x * x;
  return ((-1.9515296e-4f * z + 8.332161e-3f) * z - 1.6666655e-1f) * z * x + x;
}
static inline float cos_poly(float x) {
  float z = x * x;
  return ((2.4433157e-5f * z - 1.3887316e-3f) * z + 4.1666646e-2f) * z * z - 0.5f * z + 1.0f;
}
static inline float sin_near(float x) {
  i32 k;
  float r = quarter(x, &k), s = sin_poly(r), c = cos_poly(r);
  float v = (k & 1) == 0 ? s : c;
  float w = (k & 2) == 0 ? v : -v;
  return x == 0.0f ? x : w;
}
static inline float cos_near(float x) {
  i32 k;
  float r = quarter(x, &k), s = sin_poly(r), c = cos_poly(r);
  float v = (k & 1) == 0 ? c : s;
  return ((i32)((u32)k + 1u) & 2) == 0 ? v : -v;
}
static inline float tan_near(float x) {
  i32 k;
  float r = quarter(x, &k), z = r * r;
  float p = (((((9.385402e-3f * z + 3.1199223e-3f) * z + 2.4430135e-2f) * z + 5.341128e-2f) * z + 1.3338799e-1f) * z
             + 3.3333157e-1f) * z * r + r;
  float q = (k & 1) == 0 ? p : -1.0f / p;
  return x == 0.0f ? x : q;
}
static inline float unit(float x) {
  float low = x < -1.0f ? -1.0f : x;
  return low > 1.0f ? 1.0f : low;
}
static inline float asin_poly(float z, float s) {
  return ((((4.21632e-2f * z + 2.418131e-2f) * z + 4.5470026e-2f) * z + 7.4953003e-2f) * z + 1.6666752e-1f) * z * s + s;
}
static inline float asin_(float y) {
  float x = unit(y), a = ABS(x), h = 0.5f * (1.0f - a);
  float z = a > 0.5f ? h : a * a, s = a > 0.5f ? SQRT(z) : a, p = asin_poly(z, s);
  return COPYSIGN(a > 0.5f ? 0x1.921fb6p+0f - 2.0f * p : p, x);
}
static inline float acos_(float y) {
  float x = unit(y), a = ABS(x), h = 0.5f * (1.0f - a);
  float z = a > 0.5f ? h : a * a, s = a > 0.5f ? SQRT(z) : a, p = asin_poly(z, s);
  float near = 0x1.921fb6p+0f - COPYSIGN(p, x);
  float far = x < 0.0f ? 0x1.921fb6p+1f - 2.0f * p : 2.0f * p;
  return a > 0.5f ? far : near;
}
static inline float atan_(float x) {
  float a = ABS(x);
  int far = a > 2.4142136f, mid = a > 0.41421357f;
  float half = mid ? 0x1.921fb6p-1f : 0.0f, base = far ? 0x1.921fb6p+0f : half;
  float m = mid ? (a - 1.0f) / (a + 1.0f) : a, r = far ? -1.0f / a : m, z = r * r;
  float p = (((8.0537445e-2f * z - 1.3877686e-1f) * z + 1.9977711e-1f) * z - 3.333295e-1f) * z * r + r;
  return COPYSIGN(base + p, x);
}
static inline int is_plain(float y, float x) {
  float a = ABS(y), b = ABS(x);
  return (a > 1e-18f) & (a < 1e18f) & (b > 1e-18f) & (b < 1e18f);
}
static inline float atan2_near(float y, float x) {
  float a = atan_(ABS(y) / ABS(x));
  return COPYSIGN(x < 0.0f ? 0x1.921fb6p+1f - a : a, y);
}
static inline int exp_is_near(float x) { return ABS(x) < 87.0f; }
static inline float exp_near(float x) {
  float k = nearest(x * 0x1.715476p+0f);
  float r = (x - k * 0.6933594f) + k * 2.1219444e-4f;
  float p = ((((1.9875691e-4f * r + 1.3981999e-3f) * r + 8.333452e-3f) * r + 4.1665796e-2f) * r + 1.6666665e-1f) * r
            + 5.0e-1f;
  float y = p * r * r + r + 1.0f;
  return y * power_of_two(to_int(k));
}
static inline float tanh_(float x) {
  float a = ABS(x), z = x * x;
  float p = ((((-5.7049887e-3f * z + 2.063909e-2f) * z - 5.3739716e-2f) * z + 1.3331442e-1f) * z - 3.333328e-1f) * z * x
            + x;
  float far = 1.0f - 2.0f / (exp_near(a > 9.5f ? 19.0f : a + a) + 1.0f);
  return a < 0.625f ? p : COPYSIGN(far, x);
}
static inline float sinh_near(float x) {
  float z = x * x, p = ((2.0372191e-4f * z + 8.330284e-3f) * z + 1.6666716e-1f) * z * x + x;
  float e = exp_near(ABS(x)), far = COPYSIGN(0.5f * e - 0.5f / e, x);
  return ABS(x) <= 1.0f ? p : far;
}
static inline float cosh_near(float x) {
  float e = exp_near(ABS(x));
  return 0.5f * e + 0.5f / e;
}
static inline int is_ordinary(float x) { return (x >= 0x1p-126f) & (x <= 0x1.fffffep+127f); }
static inline float exponent(float x, float *m) {
  u32 bits = to_bits(x);
  i32 e = (i32)((bits >> 23) & 0xffu) - 126;
  float h = of_bits((bits & 0x007fffffu) | 0x3f000000u);
  int small = h < 0x1.6a09e6p-1f;
  *m = small ? h + h : h;
  return (float)e - (small ? 1.0f : 0.0f);
}
static inline float log_near(float x) {
  float m, e = exponent(x, &m), r = m - 1.0f, z = r * r;
  float p = ((((((((7.0376836e-2f * r - 1.151461e-1f) * r + 1.1676999e-1f) * r - 1.2420141e-1f) * r + 1.4249323e-1f) * r
                - 1.6668058e-1f) * r + 2.0000715e-1f) * r - 2.4999994e-1f) * r + 3.333333e-1f) * r * z;
  return (p + e * -2.1219444e-4f - 0.5f * z) + r + e * 0.6933594f;
}
static inline double log2_of_mantissa(float mantissa) {
  double m = (double)mantissa, s = (m - 1.0) / (m + 1.0), z = s * s;
  double p = ((((z / 13.0 + 1.0 / 11.0) * z + 1.0 / 9.0) * z + 1.0 / 7.0) * z + 1.0 / 5.0) * z + 1.0 / 3.0;
  return 2.0 * 0x1.71547652b82fep+0 * (s + s * z * p);
}
static inline float log2_near(float x) {
  float m, e = exponent(x, &m);
  return e + (float)log2_of_mantissa(m);
}
static inline float log10_near(float x) {
  float m, e = exponent(x, &m);
  return (float)(((double)e + log2_of_mantissa(m)) * 0x1.34413509f79ffp-2);
}
static inline int pow_is_near(float x, float y) {
  double log2 = (double)(i32)to_bits(x) * (1.0 / 8388608.0) - 126.95;
  return is_ordinary(x) & (ABS(y) < 1e6f) & (__builtin_fabs((double)y) * (__builtin_fabs(log2) + 0.051) < 125.0);
}
static inline float pow_near(float x, float y) {
  float m, e = exponent(x, &m);
  double t = ((double)e + log2_of_mantissa(m)) * (double)y;
  double k = (t + 6755399441055744.0) - 6755399441055744.0;
  double r = (t - k) * 0x1.62e42fefa39efp-1;
  double p = 1.0 + r * (1.0 + r * (0.5 + r * (1.0 / 6.0 + r * (1.0 / 24.0
             + r * (1.0 / 120.0 + r * (1.0 / 720.0 + r * (1.0 / 5040.0)))))));
  return (float)p * power_of_two(to_int_d(k));
}
static inline float smoothstep(float e0, float e1, float x) {
  float t = (x - e0) / (e1 - e0), middle = t * t * (3.0f - 2.0f * t);
  float below = x >= e1 ? 1.0f : middle;
  return x <= e0 ? 0.0f : below;
}
static inline float clamp(float x, float low, float high) {
  float y = low > x ? low : x;
  return high < y ? high : y;
}
