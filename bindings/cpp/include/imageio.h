// Readers and writers of images. SPDX-License-Identifier: MIT OR Apache-2.0
//
// The order of the virtual functions is the binary interface. It never changes.

#ifndef GELATO_IMAGEIO_H
#define GELATO_IMAGEIO_H

#include <math.h>
#include <stdarg.h>
#include <string.h>
#include <string>
#include <vector>

#include "export.h"
#include "gelato_c.h"
#include "paramtype.h"

namespace Gelato {

// A plugin has: GELATO_EXPORT int imageio_version = Gelato::IMAGEIO_VERSION;
const int IMAGEIO_VERSION = 3;

struct ImageIOFormatSpec {
    int x, y, z;              // the first pixel within the whole image
    int width, height, depth; // the number of pixels; depth > 1 for volumes
    int full_width;           // the size of the whole image
    int full_height;
    int full_depth;
    int tile_width;           // 0 for an image in scanlines
    int tile_height;
    int tile_depth;
    int nchannels;
    ParamBaseType format;     // the type of one channel
    std::vector<const char*> channelnames;
    char unused[256];
};

struct GELATO_PUBLIC ImageIOParameter {
    const char *name;
    ParamBaseType type;
    int nvalues;
    const void *value;

    ImageIOParameter () {}
    ImageIOParameter (const char *name, ParamBaseType type,
                      int nvalues, const void *value)
        : name(name), type(type), nvalues(nvalues), value(value) {}
};

#if __cplusplus >= 201103L
#define gelato_thread_local thread_local
#elif defined(__GNUC__)
#define gelato_thread_local __thread
#else
#define gelato_thread_local
#endif

// Stores a text in an image.
inline void gelato_keep_text (char *&kept, const char *message, va_list values)
{
    char text[1024];
    vsnprintf (text, sizeof(text), message ? message : "", values);
    delete[] kept;
    kept = new char[strlen (text) + 1];
    strcpy (kept, text);
}

class GELATO_PUBLIC ImageOutput {
public:
    ImageOutput () : errmsg (NULL) {}
    virtual ~ImageOutput () { delete[] errmsg; }

    // The capabilities of the format.
    virtual bool supports_tiles (void) const { return false; }
    // True when scanlines and tiles may be written in any order.
    virtual bool supports_random_access (void) const { return false; }
    virtual bool supports_multiimage (void) const { return false; }
    virtual bool supports_volumes (void) const { return false; }
    // True when the same scanline or tile may be written more than once.
    virtual bool supports_rewrite (void) const { return false; }
    // True when NULL may be passed for pixels that are all zero.
    virtual bool supports_empty (void) const { return false; }
    virtual bool supports_rectangles (void) const { return false; }

    // The parameters are "quantize" (int[4]), "gain", "gamma", "dither" (float), and all others of the output.
    virtual bool open (const char *name, const ImageIOFormatSpec &spec,
                       int nparams, const ImageIOParameter *param, bool append=false) = 0;

    // Strides are numbers of floats.
    virtual bool write_scanline (int y, int z, const float *data, int xstride)
        { return false; }

    virtual bool write_tile (int x, int y, int z, const float *data,
                             int xstride, int ystride, int zstride) { return false; }

    // The ends are part of the rectangle.
    virtual bool write_rectangle (int xmin, int xmax, int ymin, int ymax,
                                  int zmin, int zmax, const float *data,
                                  int xstride, int ystride, int zstride)
        { return false; }

    virtual bool close () = 0;

    // Not used yet.
    virtual int send_to_output (const char *format, ...) { return 0; }
    int send_to_client (const char *format, ...) { return 0; }

    // Returns the integer for a value. 0 becomes `black` and 1 becomes `white`. `ditheramp` is the amplitude of the
    // noise that is added.
    static int quantize (float value, int black, int white,
                         int clamp_min, int clamp_max, float ditheramp) {
        float noise = 0;
        if (ditheramp != 0) {
            // Each thread has its own sequence, if the compiler supports this.
            static gelato_thread_local unsigned int state = 1;
            state = state * 1664525u + 1013904223u;
            noise = ditheramp * ((state >> 8) * (2.0f / 16777216.0f) - 1.0f);
        }
        float q = floorf (black + value * (white - black) + noise + 0.5f);
        if (! (q > (float) clamp_min))
            return clamp_min;
        return q < (float) clamp_max ? (int) q : clamp_max;
    }

    // Returns (value * gain) to the power of `invgamma`.
    static float exposure (float value, float gain, float invgamma) {
        float v = value * gain;
        return invgamma == 1 || v <= 0 ? v : powf (v, invgamma);
    }

    // Stores the reason why a function returns false.
    void error (const char *message, ...);
    // Returns the last reason, or NULL.
    const char *error_message () { return errmsg; }

private:
    ImageOutput (const ImageOutput &);
    ImageOutput &operator= (const ImageOutput &);
    char *errmsg;
};

inline void ImageOutput::error (const char *message, ...)
{
    va_list values;
    va_start (values, message);
    gelato_keep_text (errmsg, message, values);
    va_end (values);
}

class GELATO_PUBLIC ImageInput {
public:
    ImageInput () : errmsg (NULL) {
        spec.x = spec.y = spec.z = spec.width = spec.height = spec.depth = 0;
        spec.full_width = spec.full_height = spec.full_depth = 0;
        spec.tile_width = spec.tile_height = spec.tile_depth = spec.nchannels = 0;
        spec.format = PT_UNKNOWN;
        memset (spec.unused, 0, sizeof(spec.unused));
    }
    virtual ~ImageInput () { delete[] errmsg; }

    // Describes the first image in `newspec` and in `this->spec`.
    virtual bool open (const char *name, ImageIOFormatSpec &newspec,
                       int nparams, const ImageIOParameter *param) = 0;

    virtual int current_subimage (void) const { return 0; }

    virtual bool seek_subimage (int index, ImageIOFormatSpec &newspec) {
        return false;
    }

    // Read pixels as floats, with strides in floats. The default implementations call read_native_... and convert.
    virtual bool read_scanline (int y, int z, float *data, int xstride);
    virtual bool read_tile (int x, int y, int z, float *data,
                            int xstride, int ystride, int zstride);

    bool read_scanline (int y, int z, float *data) {
        return read_scanline (y, z, data, spec.nchannels);
    }
    bool read_tile (int x, int y, int z, float *data) {
        return read_tile (x, y, z, data, spec.nchannels,
                          spec.nchannels*spec.tile_width,
                          spec.nchannels*spec.tile_width*spec.tile_height);
    }

    // Read pixels in the type of the file, without gaps.
    virtual bool read_native_scanline (int y, int z, void *data) = 0;
    virtual bool read_native_tile (int x, int y, int z, void *data) {
        return false;
    }

    virtual bool get_parameter (const char *name, ParamType t, void *val) {
        return false;
    }

    virtual bool close () = 0;

    virtual int send_to_input (const char *format, ...) { return 0; }
    int send_to_client (const char *format, ...) { return 0; }

    void error (const char *message, ...);
    const char *error_message () { return errmsg; }

private:
    ImageInput (const ImageInput &);
    ImageInput &operator= (const ImageInput &);
    bool convert (const void *native, int width, int height, int depth, float *data,
                  int xstride, int ystride, int zstride);
    char *errmsg;
protected:
    ImageIOFormatSpec spec; // the current image
};

inline void ImageInput::error (const char *message, ...)
{
    va_list values;
    va_start (values, message);
    gelato_keep_text (errmsg, message, values);
    va_end (values);
}

// Returns a value of a file as a float. Integers become 0 to 1 (signed ones -1 to 1). Floats are not scaled.
inline float gelato_to_float (const void *native, size_t i, ParamBaseType format)
{
    switch (format) {
    case PT_UINT8: return ((const unsigned char *) native)[i] / 255.0f;
    case PT_INT8: return ((const signed char *) native)[i] / 127.0f;
    case PT_UINT16: return ((const unsigned short *) native)[i] / 65535.0f;
    case PT_INT16: return ((const short *) native)[i] / 32767.0f;
    case PT_UINT: return (float) (((const unsigned int *) native)[i] / 4294967295.0);
    case PT_INT: return (float) (((const int *) native)[i] / 2147483647.0);
    case PT_DOUBLE: return (float) ((const double *) native)[i];
    case PT_HALF: {
        unsigned int h = ((const unsigned short *) native)[i];
        int exponent = (h >> 10) & 31, mantissa = h & 1023;
        float v = exponent == 0 ? ldexpf ((float) mantissa, -24)
            : exponent == 31 ? (mantissa ? NAN : INFINITY)
            : ldexpf ((float) (mantissa | 1024), exponent - 25);
        return h & 0x8000 ? -v : v;
    }
    default: return ((const float *) native)[i];
    }
}

inline bool ImageInput::convert (const void *native, int width, int height, int depth, float *data,
                                 int xstride, int ystride, int zstride)
{
    size_t i = 0;
    for (int z = 0; z < depth; ++z)
        for (int y = 0; y < height; ++y)
            for (int x = 0; x < width; ++x) {
                float *pixel = data + (ptrdiff_t) z * zstride + (ptrdiff_t) y * ystride + (ptrdiff_t) x * xstride;
                for (int c = 0; c < spec.nchannels; ++c, ++i)
                    pixel[c] = gelato_to_float (native, i, spec.format);
            }
    return true;
}

inline bool ImageInput::read_scanline (int y, int z, float *data, int xstride)
{
    size_t bytes = (size_t) spec.width * spec.nchannels * ParamBaseTypeSize (spec.format);
    if (bytes == 0)
        return false;
    // Doubles give the alignment that any type needs.
    std::vector<double> native ((bytes + sizeof(double) - 1) / sizeof(double));
    return read_native_scanline (y, z, &native[0])
        && convert (&native[0], spec.width, 1, 1, data, xstride, 0, 0);
}

inline bool ImageInput::read_tile (int x, int y, int z, float *data,
                                   int xstride, int ystride, int zstride)
{
    int depth = spec.tile_depth > 0 ? spec.tile_depth : 1;
    size_t bytes = (size_t) spec.tile_width * spec.tile_height * depth * spec.nchannels
        * ParamBaseTypeSize (spec.format);
    if (bytes == 0)
        return false;
    std::vector<double> native ((bytes + sizeof(double) - 1) / sizeof(double));
    return read_native_tile (x, y, z, &native[0])
        && convert (&native[0], spec.tile_width, spec.tile_height, depth, data, xstride, ystride, zstride);
}

// Search for a plugin in `searchpath`, and use the formats of the suite otherwise. Return NULL on failure; see
// ImageIOErrorMessage. They are for programs only, which link with libgelato.
inline ImageOutput *MakeImageOutput (const char *filename,
                                     const char *format,
                                     const char *searchpath)
{
    return static_cast<ImageOutput *> (gelato_make_image_output (filename, format, searchpath));
}
inline ImageOutput *MakeImageOutput (const char *filename,
                                     const char *searchpath)
{
    return MakeImageOutput (filename, NULL, searchpath);
}
inline ImageInput *MakeImageInput (const char *filename,
                                   const char *searchpath)
{
    return static_cast<ImageInput *> (gelato_make_image_input (filename, searchpath));
}

inline const char *ImageIOErrorMessage () { return gelato_image_error (); }

// Returns the value of the first parameter of this name, type and count, and stores its index. Returns NULL and stores
// -1 when there is none.
inline const void *IOParamFindValue (const char *name, ParamBaseType type,
                                     int count, int& index, int nparams,
                                     const ImageIOParameter *param)
{
    for (index = 0; index < nparams; ++index)
        if (param[index].type == type && param[index].nvalues == count && ! strcmp (param[index].name, name))
            return param[index].value;
    index = -1;
    return NULL;
}

// Returns the string of this name, or NULL.
inline const char *IOParamFindString (const char *name, int nparams,
                                      const ImageIOParameter *param)
{
    int index;
    const void *value = IOParamFindValue (name, PT_STRING, 1, index, nparams, param);
    return value ? *(const char *const *) value : NULL;
}

inline void _ImageIO_force_link () {}

} /* end namespace Gelato */

#endif // GELATO_IMAGEIO_H
