/* Functions of RSL, written in this language, for shaders that were translated from RSL. Names that both languages have
   get further forms. */
#ifndef RSL_H
#define RSL_H

#define PI_2 (PI / 2)
#define EPS 1e-6
#define MINFILTWIDTH 1e-6
#define filterwidthp(p) max (sqrt (samplearea (p)), MINFILTWIDTH)
#define sampled(x) (x)

float min (float x, float y, float z) { return min (x, min (y, z)); }
float max (float x, float y, float z) { return max (x, max (y, z)); }
float min (float x, float y, float z, float w) { return min (min (x, y), min (z, w)); }
float max (float x, float y, float z, float w) { return max (max (x, y), max (z, w)); }
color max (color x, color y, color z) { return max (x, max (y, z)); }
color min (color x, color y, color z) { return min (x, min (y, z)); }

color mix (color x, color y, color alpha) { return x * (1 - alpha) + y * alpha; }
float abs (vector v) { return length (v); }
color pow (color x, float y) { return color (pow (x[0], y), pow (x[1], y), pow (x[2], y)); }
color sqrt (color x) { return color (sqrt (x[0]), sqrt (x[1]), sqrt (x[2])); }
float acos (vector a, vector b) { return acos (dot (normalize (a), normalize (b))); }

void fresnel (vector I, normal N, float eta, output float Kr, output float Kt)
{
    vector R, T;
    fresnel (I, N, eta, Kr, Kt, R, T);
}

float comp (color c, float i) { return c[i]; }
float comp (point p, float i) { return p[i]; }
float comp (matrix m, float i, float j) { return m[i][j]; }
void setcomp (output color c, float i, float x) { c[i] = x; }
void setcomp (output point p, float i, float x) { p[i] = x; }
float xcomp (point p) { return p[0]; }
float ycomp (point p) { return p[1]; }
float zcomp (point p) { return p[2]; }
void setxcomp (output point p, float x) { p[0] = x; }
void setycomp (output point p, float y) { p[1] = y; }
void setzcomp (output point p, float z) { p[2] = z; }

vector vtransform (string to, vector v) { return transformv (to, v); }
vector vtransform (string from, string to, vector v) { return transformv (from, to, v); }
normal ntransform (string to, normal n) { return transformn (to, n); }
normal ntransform (string from, string to, normal n) { return transformn (from, to, n); }
color ctransform (string to, color c) { return transformc (to, c); }
color ctransform (string from, string to, color c) { return transformc (from, to, c); }

float Du (float x) { return deltau (x) / deltau (u); }
float Dv (float x) { return deltav (x) / deltav (v); }
vector Du (point p) { return deltau (p) / deltau (u); }
vector Dv (point p) { return deltav (p) / deltav (v); }
float area (point p) { return samplearea (p); }
normal calculatenormal (point p) { return surfacenormal (p); }
float depth (point p) { return length (p); }
float filterstep (float edge, float x) { return aastep (edge, x); }
float filterstep (float edge, float x0, float x1) { return aastep (edge, (x0 + x1) / 2, abs (x1 - x0)); }
float cellnoise (float x) { return cnoise (x); }
float cellnoise (float x, float y) { return cnoise (x, y); }
float cellnoise (point p) { return cnoise (p); }
color cellnoise (float x, float y) { return cnoise (x, y); }

/* Lights of RSL have their own falloff. Loops over lights cover the half space in front of N. */
color phong (vector N, vector V, float size)
{
    color sum = 0;
    vector R = reflect (-normalize (V), normalize (N));
    lights (P, N, PI / 2) {
        vector Ln = normalize (L);
        sum += Cl * pow (max (0, dot (R, Ln)), size);
    }
    return sum;
}

color specularstd (normal N, vector V, float roughness)
{
    color sum = 0;
    lights (P, N, PI / 2) {
        vector H = normalize (normalize (L) + V);
        sum += Cl * pow (max (0, dot (N, H)), 1 / roughness);
    }
    return sum;
}

float pulse (float a, float b, float fuzz, float x) { return smoothstep (a - fuzz, a, x) - smoothstep (b - fuzz, b, x); }
float boxstep (float a, float b, float x) { return clamp ((x - a) / (b - a), 0, 1); }
float bias (float b, float x) { return pow (x, log (b) / log (0.5)); }
float gain (float g, float x) { return x < 0.5 ? bias (1 - g, 2 * x) / 2 : 1 - bias (1 - g, 2 - 2 * x) / 2; }

float fBm (point p, float octaves, float lacunarity, float gain)
{
    float sum = 0, amp = 1;
    point pp = p;
    float i;
    for (i = 0; i < octaves; i += 1) {
        sum += amp * snoise (pp);
        amp *= gain;
        pp *= lacunarity;
    }
    return sum;
}

float turbulence (point p, float octaves)
{
    float sum = 0, f = 1, i;
    for (i = 0; i < octaves; i += 1) {
        sum += abs (0.5 - noise (p * f)) / f;
        f *= 2;
    }
    return sum;
}

#endif
