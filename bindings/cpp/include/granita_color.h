/* Colour conversions of another library, for configurations that Granita does not support by itself.
 *
 * A plugin is a shared library NAME.color.so with the functions below. Granita looks for opencolorio.color.so on
 * $GELATO_IMAGEIO_PATH, in $GELATOHOME/lib and where -plugins says, when a conversion needs it.
 *
 * Texts are UTF-8 and end with a zero. Functions may be called by several threads at once. None may throw.
 */
#ifndef GRANITA_COLOR_H
#define GRANITA_COLOR_H

#include <stddef.h>

#if defined(_WIN32)
#define GRANITA_COLOR_EXPORT __declspec(dllexport)
#else
#define GRANITA_COLOR_EXPORT __attribute__((visibility("default")))
#endif

#ifdef __cplusplus
extern "C" {
#endif

/* The version of this interface, which granita_color_version () returns. */
#define GRANITA_COLOR_VERSION 1

/* The kinds of conversions, with the meaning of a, b and c. */
enum granita_color_kind {
    GRANITA_COLOR_SPACES = 0, /* a: source space, b: target space */
    GRANITA_COLOR_VIEW = 1,   /* a: source space, b: display, c: view */
    GRANITA_COLOR_LOOKS = 2,  /* a: source space, b: target space, c: looks */
    GRANITA_COLOR_FILE = 3    /* a: the file of a transform */
};

/* A conversion that is ready for pixels. */
typedef struct granita_color granita_color;

/* Returns GRANITA_COLOR_VERSION. */
GRANITA_COLOR_EXPORT int granita_color_version(void);

/* Returns the name and the version of the library, such as "OpenColorIO 2.1.2". It is never freed. */
GRANITA_COLOR_EXPORT const char *granita_color_library(void);

/* Returns a conversion of a configuration: the name of a file, or ocio://NAME. Unused texts are empty. With inverse = 1 a
 * file is inverted. After an error it returns NULL and writes the reason to `error`, which has room for `room` bytes. */
GRANITA_COLOR_EXPORT granita_color *granita_color_open(const char *config, int kind, const char *a, const char *b,
                                                       const char *c, int inverse, char *error, size_t room);

/* Converts pixels in place: three floats each, red, green and blue. */
GRANITA_COLOR_EXPORT void granita_color_apply(const granita_color *conversion, float *rgb, size_t pixels);

/* Frees a conversion. */
GRANITA_COLOR_EXPORT void granita_color_close(granita_color *conversion);

#ifdef __cplusplus
}
#endif

#endif
