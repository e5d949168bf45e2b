// Vectors, matrices, boxes. SPDX-License-Identifier: MIT OR Apache-2.0
//
// Vectors are rows, and matrices are stored row by row. `v * A * B` applies A first, and a translation is in the last
// row. Angles are in degrees. Most functions have two forms, such as `a.length ()` and `length (a)`, or
// `Matrix4::translate (x, y, z)` and `TranslationMatrix (x, y, z)`.

#ifndef GELATO_VECMAT_H
#define GELATO_VECMAT_H

#include <math.h>

#include "export.h"

namespace Gelato {

class GELATO_PUBLIC Vector3 {
public:
    float x, y, z;

    Vector3 () {}
    explicit Vector3 (float v) : x(v), y(v), z(v) {}
    Vector3 (float x, float y, float z) : x(x), y(y), z(z) {}
    explicit Vector3 (const float *v) : x(v[0]), y(v[1]), z(v[2]) {}

    float &operator[] (int i) { return (&x)[i]; }
    float operator[] (int i) const { return (&x)[i]; }
    const float *data () const { return &x; }

    Vector3 operator+ (const Vector3 &v) const { return Vector3 (x + v.x, y + v.y, z + v.z); }
    Vector3 operator- (const Vector3 &v) const { return Vector3 (x - v.x, y - v.y, z - v.z); }
    Vector3 operator* (const Vector3 &v) const { return Vector3 (x * v.x, y * v.y, z * v.z); }
    Vector3 operator* (float s) const { return Vector3 (x * s, y * s, z * s); }
    Vector3 operator/ (float s) const { return Vector3 (x / s, y / s, z / s); }
    Vector3 operator- () const { return Vector3 (-x, -y, -z); }
    const Vector3 &operator+= (const Vector3 &v) { return *this = *this + v; }
    const Vector3 &operator-= (const Vector3 &v) { return *this = *this - v; }
    const Vector3 &operator*= (float s) { return *this = *this * s; }
    const Vector3 &operator/= (float s) { return *this = *this / s; }
    bool operator== (const Vector3 &v) const { return x == v.x && y == v.y && z == v.z; }
    bool operator!= (const Vector3 &v) const { return ! (*this == v); }

    float dot (const Vector3 &v) const { return x * v.x + y * v.y + z * v.z; }
    Vector3 cross (const Vector3 &v) const {
        return Vector3 (y * v.z - z * v.y, z * v.x - x * v.z, x * v.y - y * v.x);
    }
    float length2 () const { return dot (*this); }
    float length () const { return sqrtf (dot (*this)); }
    // Returns the vector with length 1. A vector of length 0 is returned unchanged.
    Vector3 normalized () const {
        float l = length ();
        return l > 0 ? *this / l : *this;
    }
    // Sets the length of this vector to 1.
    const Vector3 &normalize () { return *this = normalized (); }

    static Vector3 Zero () { return Vector3 (0.0f); }
};

inline Vector3 operator* (float s, const Vector3 &v) { return v * s; }
inline float dot (const Vector3 &a, const Vector3 &b) { return a.dot (b); }
inline Vector3 cross (const Vector3 &a, const Vector3 &b) { return a.cross (b); }
inline float length (const Vector3 &v) { return v.length (); }
inline float length2 (const Vector3 &v) { return v.length2 (); }
inline float distance (const Vector3 &a, const Vector3 &b) { return (a - b).length (); }
inline Vector3 normalize (const Vector3 &v) { return v.normalized (); }

// Interpolate linearly: `a` at t = 0, `b` at t = 1.
inline float lerp (float a, float b, float t) { return a * (1 - t) + b * t; }
inline Vector3 lerp (const Vector3 &a, const Vector3 &b, float t) { return a * (1 - t) + b * t; }

class GELATO_PUBLIC Vector4 {
public:
    float x, y, z, w;

    Vector4 () {}
    Vector4 (float x, float y, float z, float w) : x(x), y(y), z(z), w(w) {}
    explicit Vector4 (const float *v) : x(v[0]), y(v[1]), z(v[2]), w(v[3]) {}
    explicit Vector4 (const Vector3 &v, float w=1) : x(v.x), y(v.y), z(v.z), w(w) {}

    float &operator[] (int i) { return (&x)[i]; }
    float operator[] (int i) const { return (&x)[i]; }
    const float *data () const { return &x; }

    Vector4 operator+ (const Vector4 &v) const { return Vector4 (x + v.x, y + v.y, z + v.z, w + v.w); }
    Vector4 operator- (const Vector4 &v) const { return Vector4 (x - v.x, y - v.y, z - v.z, w - v.w); }
    Vector4 operator* (float s) const { return Vector4 (x * s, y * s, z * s, w * s); }
    bool operator== (const Vector4 &v) const { return x == v.x && y == v.y && z == v.z && w == v.w; }
    bool operator!= (const Vector4 &v) const { return ! (*this == v); }

    float dot (const Vector4 &v) const { return x * v.x + y * v.y + z * v.z + w * v.w; }
    float length () const { return sqrtf (dot (*this)); }
    // Returns the point of these homogeneous coordinates.
    Vector3 project () const { return Vector3 (x / w, y / w, z / w); }
};

inline Vector4 operator* (float s, const Vector4 &v) { return v * s; }
inline float dot (const Vector4 &a, const Vector4 &b) { return a.dot (b); }
inline float length (const Vector4 &v) { return v.length (); }
inline Vector4 lerp (const Vector4 &a, const Vector4 &b, float t) { return a * (1 - t) + b * t; }

class GELATO_PUBLIC Matrix4 {
public:
    float m[4][4];

    // Makes a matrix that is not initialised.
    Matrix4 () {}
    // Makes a matrix with this number on the diagonal, and 0 elsewhere.
    explicit Matrix4 (float diagonal) {
        for (int i = 0; i < 16; ++i)
            m[i / 4][i % 4] = i % 5 == 0 ? diagonal : 0;
    }
    // Makes a matrix of 16 numbers, row by row.
    Matrix4 (float m00, float m01, float m02, float m03, float m10, float m11, float m12, float m13,
             float m20, float m21, float m22, float m23, float m30, float m31, float m32, float m33) {
        const float values[16] = { m00, m01, m02, m03, m10, m11, m12, m13, m20, m21, m22, m23, m30, m31, m32, m33 };
        for (int i = 0; i < 16; ++i)
            m[i / 4][i % 4] = values[i];
    }
    explicit Matrix4 (const float *values) {
        for (int i = 0; i < 16; ++i)
            m[i / 4][i % 4] = values[i];
    }

    float *operator[] (int row) { return m[row]; }
    const float *operator[] (int row) const { return m[row]; }
    const float *data () const { return &m[0][0]; }

    // Returns the matrix of zeros.
    static Matrix4 Zero () { return Matrix4 (0.0f); }
    // Returns the identity.
    static Matrix4 Ident () { return Matrix4 (1.0f); }

    static Matrix4 translate (float x, float y, float z) {
        Matrix4 t (1);
        t.m[3][0] = x, t.m[3][1] = y, t.m[3][2] = z;
        return t;
    }
    static Matrix4 scale (float x, float y, float z) {
        Matrix4 s (1);
        s.m[0][0] = x, s.m[1][1] = y, s.m[2][2] = z;
        return s;
    }
    // Returns the rotation about `axis` by `angle` degrees.
    static Matrix4 rotate (float angle, const Vector3 &axis) {
        Vector3 a = axis.normalized ();
        float c = cosf (angle * 0.017453292519943295f), s = sinf (angle * 0.017453292519943295f), t = 1 - c;
        Matrix4 r (1);
        r.m[0][0] = t * a.x * a.x + c, r.m[0][1] = t * a.x * a.y + s * a.z, r.m[0][2] = t * a.x * a.z - s * a.y;
        r.m[1][0] = t * a.x * a.y - s * a.z, r.m[1][1] = t * a.y * a.y + c, r.m[1][2] = t * a.y * a.z + s * a.x;
        r.m[2][0] = t * a.x * a.z + s * a.y, r.m[2][1] = t * a.y * a.z - s * a.x, r.m[2][2] = t * a.z * a.z + c;
        return r;
    }

    Matrix4 operator* (const Matrix4 &b) const {
        Matrix4 p;
        for (int i = 0; i < 4; ++i)
            for (int j = 0; j < 4; ++j)
                p.m[i][j] = m[i][0] * b.m[0][j] + m[i][1] * b.m[1][j] + m[i][2] * b.m[2][j] + m[i][3] * b.m[3][j];
        return p;
    }
    const Matrix4 &operator*= (const Matrix4 &b) { return *this = *this * b; }
    Matrix4 operator* (float s) const {
        Matrix4 p;
        for (int i = 0; i < 16; ++i)
            p.m[i / 4][i % 4] = m[i / 4][i % 4] * s;
        return p;
    }
    Matrix4 operator+ (const Matrix4 &b) const {
        Matrix4 p;
        for (int i = 0; i < 16; ++i)
            p.m[i / 4][i % 4] = m[i / 4][i % 4] + b.m[i / 4][i % 4];
        return p;
    }
    bool operator== (const Matrix4 &b) const {
        for (int i = 0; i < 16; ++i)
            if (data ()[i] != b.data ()[i])
                return false;
        return true;
    }
    bool operator!= (const Matrix4 &b) const { return ! (*this == b); }

    Matrix4 transposed () const {
        Matrix4 t;
        for (int i = 0; i < 16; ++i)
            t.m[i / 4][i % 4] = m[i % 4][i / 4];
        return t;
    }
    Matrix4 transpose () const { return transposed (); }

    // Returns the inverse, or Zero () for a singular matrix.
    Matrix4 inverse () const {
        Matrix4 result;
        return inverse (result) ? result : Zero ();
    }
    // Stores the inverse in `result`. For a singular matrix it returns false, and `result` does not change.
    bool inverse (Matrix4 &result) const {
        double a[4][8];
        for (int i = 0; i < 4; ++i)
            for (int j = 0; j < 8; ++j)
                a[i][j] = j < 4 ? m[i][j] : (j - 4 == i);
        for (int c = 0; c < 4; ++c) {
            int pivot = c;
            for (int i = c + 1; i < 4; ++i)
                if (fabs (a[i][c]) > fabs (a[pivot][c]))
                    pivot = i;
            if (a[pivot][c] == 0)
                return false;
            for (int j = 0; j < 8; ++j) {
                double swapped = a[c][j];
                a[c][j] = a[pivot][j];
                a[pivot][j] = swapped;
            }
            double scale = 1 / a[c][c];
            for (int j = 0; j < 8; ++j)
                a[c][j] *= scale;
            for (int i = 0; i < 4; ++i) {
                double factor = a[i][c];
                for (int j = 0; i != c && j < 8; ++j)
                    a[i][j] -= factor * a[c][j];
            }
        }
        for (int i = 0; i < 16; ++i)
            result.m[i / 4][i % 4] = (float) a[i / 4][4 + i % 4];
        return true;
    }

    Vector4 transform (const Vector4 &v) const {
        Vector4 r;
        for (int j = 0; j < 4; ++j)
            r[j] = v.x * m[0][j] + v.y * m[1][j] + v.z * m[2][j] + v.w * m[3][j];
        return r;
    }
    Vector3 transformp (const Vector3 &p) const { return transform (Vector4 (p, 1)).project (); }
    Vector3 transformv (const Vector3 &v) const {
        Vector4 r = transform (Vector4 (v, 0));
        return Vector3 (r.x, r.y, r.z);
    }
    // Transforms a normal. The result is perpendicular to the surface that transformv transforms. Its length changes.
    Vector3 transformn (const Vector3 &n) const { return inverse ().transposed ().transformv (n); }
};

inline Matrix4 inverse (const Matrix4 &m) { return m.inverse (); }
inline Matrix4 transpose (const Matrix4 &m) { return m.transposed (); }
inline Matrix4 lerp (const Matrix4 &a, const Matrix4 &b, float t) { return a * (1 - t) + b * t; }
inline Vector3 transformp (const Matrix4 &m, const Vector3 &p) { return m.transformp (p); }
inline Vector3 transformv (const Matrix4 &m, const Vector3 &v) { return m.transformv (v); }
inline Vector3 transformn (const Matrix4 &m, const Vector3 &n) { return m.transformn (n); }

inline Matrix4 TranslationMatrix (float x, float y, float z) { return Matrix4::translate (x, y, z); }
inline Matrix4 TranslationMatrix (const Vector3 &t) { return Matrix4::translate (t.x, t.y, t.z); }
inline Matrix4 ScaleMatrix (float x, float y, float z) { return Matrix4::scale (x, y, z); }
inline Matrix4 ScaleMatrix (const Vector3 &s) { return Matrix4::scale (s.x, s.y, s.z); }
inline Matrix4 ScaleMatrix (float s) { return Matrix4::scale (s, s, s); }
inline Matrix4 RotationMatrix (float angle, float x, float y, float z)
{
    return Matrix4::rotate (angle, Vector3 (x, y, z));
}
inline Matrix4 RotationMatrix (float angle, const Vector3 &axis) { return Matrix4::rotate (angle, axis); }

inline Vector4 operator* (const Vector4 &v, const Matrix4 &m) { return m.transform (v); }

// An axis-aligned box, which is initially empty.
class GELATO_PUBLIC Bbox3 {
public:
    Vector3 min, max;

    Bbox3 () : min (1e38f), max (-1e38f) {}
    Bbox3 (const Vector3 &min, const Vector3 &max) : min (min), max (max) {}

    bool empty () const { return min.x > max.x || min.y > max.y || min.z > max.z; }
    void extend (const Vector3 &p) {
        for (int i = 0; i < 3; ++i) {
            if (p[i] < min[i])
                min[i] = p[i];
            if (p[i] > max[i])
                max[i] = p[i];
        }
    }
    void extend (const Bbox3 &b) {
        if (! b.empty ()) {
            extend (b.min);
            extend (b.max);
        }
    }
    bool contains (const Vector3 &p) const {
        return p.x >= min.x && p.x <= max.x && p.y >= min.y && p.y <= max.y && p.z >= min.z && p.z <= max.z;
    }
    // Stores the bound in the order of Input: xmin, xmax, ymin, ymax, zmin, zmax.
    void store (float *bound) const {
        for (int i = 0; i < 3; ++i) {
            bound[2 * i] = min[i];
            bound[2 * i + 1] = max[i];
        }
    }
};

} /* end namespace Gelato */

#endif /* GELATO_VECMAT_H */
