// Colours. SPDX-License-Identifier: MIT OR Apache-2.0

#ifndef GELATO_COLOR_H
#define GELATO_COLOR_H

#include "export.h"

namespace Gelato {

// A colour of three numbers, by default red, green and blue.
class GELATO_PUBLIC Color3 {
public:
    float r, g, b;

    Color3 () {}
    explicit Color3 (float v) : r(v), g(v), b(v) {}
    Color3 (float r, float g, float b) : r(r), g(g), b(b) {}
    explicit Color3 (const float *c) : r(c[0]), g(c[1]), b(c[2]) {}

    float &operator[] (int i) { return (&r)[i]; }
    float operator[] (int i) const { return (&r)[i]; }
    const float *data () const { return &r; }

    Color3 operator+ (const Color3 &c) const { return Color3 (r + c.r, g + c.g, b + c.b); }
    Color3 operator- (const Color3 &c) const { return Color3 (r - c.r, g - c.g, b - c.b); }
    Color3 operator* (const Color3 &c) const { return Color3 (r * c.r, g * c.g, b * c.b); }
    Color3 operator/ (const Color3 &c) const { return Color3 (r / c.r, g / c.g, b / c.b); }
    Color3 operator* (float s) const { return Color3 (r * s, g * s, b * s); }
    Color3 operator/ (float s) const { return Color3 (r / s, g / s, b / s); }
    Color3 operator- () const { return Color3 (-r, -g, -b); }
    const Color3 &operator+= (const Color3 &c) { return *this = *this + c; }
    const Color3 &operator-= (const Color3 &c) { return *this = *this - c; }
    const Color3 &operator*= (const Color3 &c) { return *this = *this * c; }
    const Color3 &operator*= (float s) { return *this = *this * s; }
    const Color3 &operator/= (float s) { return *this = *this / s; }
    bool operator== (const Color3 &c) const { return r == c.r && g == c.g && b == c.b; }
    bool operator!= (const Color3 &c) const { return ! (*this == c); }

    // Returns the same luminance as luminance () of the shading language.
    float luminance () const { return 0.2126f * r + 0.7152f * g + 0.0722f * b; }
};

inline Color3 operator* (float s, const Color3 &c) { return c * s; }

// Interpolate linearly: `a` at t = 0, `b` at t = 1.
inline Color3 mix (const Color3 &a, const Color3 &b, float t) { return a * (1 - t) + b * t; }
inline Color3 lerp (const Color3 &a, const Color3 &b, float t) { return mix (a, b, t); }

} /* end namespace Gelato */

#endif /* GELATO_COLOR_H */
