/* The texture system of Granita for programs in C, C++ and other languages.
   SPDX-License-Identifier: MIT OR Apache-2.0

   A system holds textures and a cache of their tiles. Every function may be called from any thread, and many threads may
   look up points of one system at once. Only granita_texture_destroy must not run beside other calls of its system.
   Functions that return an int return GRANITA_TEXTURE_OK or another status, and granita_texture_error returns the text
   of the last failure of the thread. Strings are UTF-8 and end with 0. Arguments belong to the caller and are not kept.
   Programs link -lgranita_texture. */

#ifndef GRANITA_TEXTURE_H
#define GRANITA_TEXTURE_H

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/* The version of this interface. A system of another version is refused by granita_texture_create. */
#define GRANITA_TEXTURE_ABI 1

enum granita_texture_status {
    GRANITA_TEXTURE_OK = 0,
    GRANITA_TEXTURE_MISUSE = 1,      /* an argument is not valid */
    GRANITA_TEXTURE_UNUSABLE = 2,    /* the texture does not exist or cannot be read; results are `fill` */
    GRANITA_TEXTURE_ABSENT = 3,      /* there is no datum of this name */
    GRANITA_TEXTURE_INTERNAL = 4     /* a defect of the library; results are undefined */
};

/* Returns the version of the library, such as "0.1.0", and that of its interface. */
const char *granita_texture_version (void);
int granita_texture_abi (void);

/* ---- Systems ---- */

typedef struct granita_texture_system granita_texture_system;

/* What a system is made of. 0 and NULL stand for the defaults, so that { GRANITA_TEXTURE_ABI } is complete. */
typedef struct granita_texture_settings {
    int abi;                        /* GRANITA_TEXTURE_ABI */
    int threads;                    /* threads of one call with many points; default 1, and -1 is one for each processor */
    uint64_t memory;                /* the largest number of bytes of tiles held at once; default 256 MiB */
    int files;                      /* the largest number of files open at once; default 1000 */
    int no_automipmap;              /* 1: refuse files without tiles or MIP levels, instead of making them in memory */
    const char *search_path;        /* folders to search, separated by ':'; default "." */
    const char *plugin_path;        /* folders and files of image format plugins, separated by ':'; default none */
} granita_texture_settings;

/* Returns a system, or NULL after a failure. `settings` may be NULL. */
granita_texture_system *granita_texture_create (const granita_texture_settings *settings);
void granita_texture_destroy (granita_texture_system *system);

/* Returns the reason of the last failure of a function of this header in this thread; "" when there was none. The text
   is valid until the next failure in this thread. */
const char *granita_texture_error (void);

/* Returns the messages of a system since the last call, one a line that begins with "warning: " or "error: ", such as those about
   tiles that cannot be read; NULL when there are none. The caller passes the text to granita_texture_free. */
char *granita_texture_messages (granita_texture_system *system);

/* Frees a text that a function returned. */
void granita_texture_free (char *text);

/* Sets the number of threads of one call with many points, as in the settings. */
int granita_texture_set_threads (granita_texture_system *system, int threads);

/* Reads a texture, or all textures with NULL, again when it is used next, because its file has changed. Waits until
   lookups that run are done. Handles stay valid. */
int granita_texture_invalidate (granita_texture_system *system, const char *name);

/* ---- Textures ---- */

/* A texture of one system, from 1. 0 is none. */
typedef uint32_t granita_texture_handle;

/* Finds a texture. The name is that of a file, of an image in a file ("parts.exr#2"), or of a set ("wall.<UDIM>.tx",
   "wall.<UVTILE>.tx"). Returns 0 when it cannot be used. The same name has the same handle. */
granita_texture_handle granita_texture_open (granita_texture_system *system, const char *name);

/* Data about a texture; for a set those of its first square. Strings and arrays are valid until the system is
   destroyed. */
typedef struct granita_texture_info {
    const char *path;               /* the file that was found */
    const char *kind;               /* "Plain Texture", "Shadow", "CubeFace Shadow", "Volume Shadow", "CubeFace Volume
                                       Shadow", "CubeFace Environment", "LatLong Environment" or "Volume Texture" */
    const char *type;               /* "texture", "environment", "shadow" or "volume" */
    const char *format;             /* the type of stored values: "uint8", "uint16", "uint32", "half" or "float" */
    const char *swrap, *twrap;      /* "black", "clamp", "periodic" or "mirror" */
    int width, height;              /* texels of the largest level, with all faces of a cube */
    int face_width, face_height;    /* texels of one face of a cube; otherwise width and height */
    int tile_width, tile_height;    /* texels of a tile; 0 when the levels are held in memory */
    int channels;
    int levels;                     /* MIP levels */
    int squares;                    /* the number of textures of a set; otherwise 0 */
    const int *level_sizes;         /* width and height of each level */
    const float *average;           /* the mean of each channel; NULL for shadow maps and volumes */
    const char *const *channel_names;
} granita_texture_info;

int granita_texture_get_info (granita_texture_system *system, granita_texture_handle texture,
                              granita_texture_info *info);

/* A datum of the file, such as "wrapmodes", "worldtocamera", "Artist" or "oiio:AverageColor". `type` is a declaration
   such as "string" or "float[3]". One of the arrays holds `count` values, and the others are NULL. They are valid until
   the system is destroyed. */
typedef struct granita_texture_metadatum {
    const char *name, *type;
    size_t count;
    const float *floats;
    const int *ints;
    const char *const *strings;
} granita_texture_metadatum;

/* Stores the datum of a name, or of an index from 0 when the name is NULL. GRANITA_TEXTURE_ABSENT: there is none. */
int granita_texture_get_metadatum (granita_texture_system *system, granita_texture_handle texture, const char *name,
                                   size_t index, granita_texture_metadatum *datum);

/* Returns all data of a texture as JSON, which the caller passes to granita_texture_free; NULL after a failure. */
char *granita_texture_info_json (granita_texture_system *system, granita_texture_handle texture);

/* ---- Lookups ---- */

/* A number of each point. That of column x and row y is at (const char *) data + x * step + y * row_step. Steps are
   bytes and may be 0 (one number for all points) or negative. NULL stands for the default. */
typedef struct granita_texture_floats {
    const float *data;
    ptrdiff_t step, row_step;
} granita_texture_floats;

/* A vector of each point: three numbers that are component_step bytes apart. */
typedef struct granita_texture_vectors {
    const float *data;
    ptrdiff_t step, row_step, component_step;
} granita_texture_vectors;

/* The points of one call and the memory of their results: columns x rows points. A list of points has one row. Channel
   c of a point is stored c * channel_step bytes after its first one. Results must not overlap with each other. */
typedef struct granita_texture_points {
    size_t columns, rows;
    float *result;
    ptrdiff_t step, row_step, channel_step;
    int channels;                   /* the number of channels to look up; shadow lookups have one */
    int first_channel;              /* the first channel of the file, from 0 */
    granita_texture_floats fill;    /* the value of channels that the file lacks; default 0 */
} granita_texture_points;

enum granita_texture_filter {
    GRANITA_TEXTURE_GAUSSIAN = 0,   /* the mean of all texels under the ellipse that derivatives, width and blur span */
    GRANITA_TEXTURE_BILINEAR = 1,   /* four texels of the largest level */
    GRANITA_TEXTURE_NEAREST = 2     /* one texel of the largest level */
};

/* Texture coordinates are fractions of the image. (0, 0) is the outer corner of the upper left texel, and (1, 1) that of
   the lower right one. Derivatives are changes from this point to the next one in x and y. Blurs are full widths as
   fractions of the image. Options have the meaning of those of texture () of the shading language. */
typedef struct granita_texture_lookup2d {
    granita_texture_floats s, t;                        /* s and t must not be NULL */
    granita_texture_floats dsdx, dtdx, dsdy, dtdy;      /* default 0 */
    granita_texture_floats sblur, tblur;                /* default 0 */
    granita_texture_floats swidth, twidth;              /* default 1; factors of the derivatives */
    const char *swrap, *twrap;      /* "black", "clamp", "periodic", "mirror"; NULL, "" or "default": as in the file */
    int filter;
} granita_texture_lookup2d;

/* Volume textures, with coordinates from (0, 0, 0) to (1, 1, 1): right, down, to the back. */
typedef struct granita_texture_lookup3d {
    granita_texture_vectors p;                          /* must not be NULL */
    granita_texture_vectors dpdx, dpdy;                 /* default 0 */
    granita_texture_floats sblur, tblur, swidth, twidth;
    const char *swrap, *twrap;
} granita_texture_lookup3d;

/* Environment maps. A direction may have any length. */
typedef struct granita_texture_environment {
    granita_texture_vectors r;                          /* must not be NULL */
    granita_texture_vectors drdx, drdy;                 /* default 0 */
    granita_texture_floats sblur, tblur;                /* default 0; 1 is 90 degrees */
    granita_texture_floats swidth, twidth;              /* default 1 */
    granita_texture_floats angle;                       /* half angle of a cone in radians, instead of the blurs */
    const char *up;                 /* "y" or "z": the axis to the upper edge; NULL, "": as in the file */
} granita_texture_environment;

/* Shadow maps. The result is the shadowed part, from 0 (lit) to 1. Points are in world space. */
typedef struct granita_texture_shadow {
    granita_texture_vectors p;                          /* must not be NULL */
    granita_texture_vectors dpdx, dpdy;                 /* default 0 */
    granita_texture_floats sblur, tblur;                /* default 0, fractions of the map */
    granita_texture_floats swidth, twidth;              /* default 1 */
    granita_texture_floats bias;                        /* default 0.01, in units of the world; is not negative */
    int samples;                                        /* 16 to 4096; 0 stands for 16 */
    uint32_t seed;                                      /* of the random positions; point i has seed and i */
} granita_texture_shadow;

int granita_texture_lookup_2d (granita_texture_system *system, granita_texture_handle texture,
                               const granita_texture_points *points, const granita_texture_lookup2d *lookup);
int granita_texture_lookup_3d (granita_texture_system *system, granita_texture_handle texture,
                               const granita_texture_points *points, const granita_texture_lookup3d *lookup);
int granita_texture_lookup_environment (granita_texture_system *system, granita_texture_handle texture,
                                        const granita_texture_points *points,
                                        const granita_texture_environment *lookup);
int granita_texture_lookup_shadow (granita_texture_system *system, granita_texture_handle texture,
                                   const granita_texture_points *points, const granita_texture_shadow *lookup);

/* Reads columns x rows texels of a level, from column x and row y on. All must lie inside of the level. */
int granita_texture_texels (granita_texture_system *system, granita_texture_handle texture, int level, int x, int y,
                            const granita_texture_points *points);

/* ---- Statistics ---- */

/* Stores a count since the system was made: "lookups", "probes", "tile_requests", "tiles_read", "tile_bytes",
   "peak_bytes", "files", "files_opened", "peak_files_open", "automipmaps", "automipmap_bytes" or "missing". */
int granita_texture_get_statistic (granita_texture_system *system, const char *name, uint64_t *value);

/* Return all counts as lines of text, or as a JSON object. The caller passes the text to granita_texture_free. */
char *granita_texture_statistics_text (granita_texture_system *system);
char *granita_texture_statistics_json (granita_texture_system *system);

#ifdef __cplusplus
}
#endif

#endif
