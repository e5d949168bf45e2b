/* The C interface below the C++ headers, and the one for plugins in other languages.
   SPDX-License-Identifier: MIT OR Apache-2.0

   The classes of the other headers are thin. Their own code is inline, and everything else goes through the functions
   and tables here. A plugin therefore needs no library at link time, and classes of one compiler are never passed to
   code of another. The interface has the version GELATO_C_ABI. A table of another version is refused. Strings are UTF-8
   and end with 0. Arguments of a function belong to the caller and are valid until it returns, unless stated
   otherwise. */

#ifndef GELATO_C_H
#define GELATO_C_H

#include <stddef.h>

#ifdef __cplusplus
extern "C" {
#endif

#define GELATO_C_ABI 2

/* ---- Messages ---- */

/* The memory of a C++ ErrorManager. Its first and only member is the table. */
typedef struct gelato_errors gelato_errors;
typedef struct gelato_errors_calls {
    int abi;
    /* `code` is an ErrCode of errormanager.h. */
    void (*say) (gelato_errors *self, int code, const char *text);
    int (*verbosity) (const gelato_errors *self);
    void (*set_verbosity) (gelato_errors *self, int verbosity);
    /* An ErrorHandler, or NULL. */
    void *(*handler) (const gelato_errors *self);
    void (*set_handler) (gelato_errors *self, void *handler);
    /* The caller frees the result with free (). */
    char *(*summary) (gelato_errors *self);
    /* Drops the contents. The memory of the object itself stays until release. */
    void (*finish) (gelato_errors *self);
    void (*release) (gelato_errors *self);
} gelato_errors_calls;
struct gelato_errors {
    const gelato_errors_calls *calls;
};

/* ---- Scene calls ---- */

/* Calls without numbers. The words are those of the C++ call, in order, and NULL where there is none. */
enum gelato_word_call {
    GELATO_INPUT = 0, GELATO_CAMERA, GELATO_OUTPUT, GELATO_WORLD, GELATO_RENDER, GELATO_COMMENT, GELATO_COMMAND,
    GELATO_PUSH_ATTRIBUTES, GELATO_POP_ATTRIBUTES, GELATO_SAVE_ATTRIBUTES, GELATO_RESTORE_ATTRIBUTES, GELATO_MODIFY,
    GELATO_PUSH_TRANSFORM, GELATO_POP_TRANSFORM, GELATO_SET_TRANSFORM_NAMED, GELATO_SHADER, GELATO_LIGHT,
    GELATO_SHADER_GROUP_BEGIN, GELATO_SHADER_GROUP_END, GELATO_CONNECT_SHADERS
};

/* Calls with `n` numbers. GELATO_INPUT_BOUND also has a word. */
enum gelato_number_call {
    GELATO_MOTION = 0,        /* n times */
    GELATO_SET_TRANSFORM,     /* 16, row by row */
    GELATO_APPEND_TRANSFORM,  /* 16 */
    GELATO_TRANSLATE,         /* 3 */
    GELATO_ROTATE,            /* angle in degrees, axis */
    GELATO_SCALE,             /* 3 */
    GELATO_SPHERE,            /* radius, zmin, zmax, thetamax in degrees */
    GELATO_INPUT_BOUND        /* xmin, xmax, ymin, ymax, zmin, zmax */
};

/* The data to which `data` of a value points. Single values and attributes are copied at once. Arrays of parameters are
   read by the call that takes the parameters, and must not change before. */
enum gelato_value_kind {
    GELATO_ANY = 0,   /* data of the type */
    GELATO_INT, GELATO_FLOAT, GELATO_DOUBLE, GELATO_STRING,      /* one value; a string is the char * itself */
    GELATO_INTS, GELATO_FLOATS, GELATO_STRINGS                   /* the number of values of the type */
};

/* A direction of a NURBS surface or curve. */
typedef struct gelato_knots {
    int n, order;
    const float *knot;
    float min, max;
} gelato_knots;

/* A receiver of scene calls, such as a renderer or an archive. `self` is the first argument of every call. Calls do not
   fail. Errors are reported through the messages of the receiver. */
typedef struct gelato_calls {
    int abi;
    void (*words) (void *self, int call, const char *a, const char *b, const char *c, const char *d);
    void (*numbers) (void *self, int call, int n, const float *values, const char *word);
    /* Parameter, or Attribute when `attribute` is not 0. `type` holds the bits of a ParamType, or 0 when the name has
       the type. */
    void (*value) (void *self, int attribute, const char *name, unsigned int type, int kind, const void *data);
    /* GetAttribute. Returns 0 when there is no such attribute. Strings are valid while the receiver lives. */
    int (*get_attribute) (void *self, const char *name, int kind, void *value);
    void (*light_switch) (void *self, const char *lightid, int on);
    void (*points) (void *self, int npoints);
    void (*curves) (void *self, const char *interp, int ncurves, int nvertspercurve);
    void (*nurbs_curves) (void *self, int ncurves, const gelato_knots *knots);
    void (*patch) (void *self, const char *interp, int nu, int nv);
    void (*nurbs_patch) (void *self, const gelato_knots *u, const gelato_knots *v);
    void (*mesh) (void *self, const char *interp, int nfaces, const int *nverts, const int *verts);
    void (*trim_curve) (void *self, int nloops, const int *ncurves, const int *n, const int *order,
                        const float *knot, const float *min, const float *max, const float *uvw);
    /* Input of a GelatoAPI::Generator, which then belongs to the receiver. */
    void (*input_generator) (void *self, void *generator, const float *bound);
    gelato_errors *(*errors) (void *self);
    /* Ends the receiver. Only its creator calls this. */
    void (*destroy) (void *self);
} gelato_calls;

/* A generator in C. NAME.generator.so exports `int generator_abi = GELATO_C_ABI;` and
   `const gelato_generator *NAME_generator_c (void);`. */
typedef struct gelato_generator {
    int abi;
    /* The extensions of the files that it reads, with NULL at the end. NULL when only its name selects it. */
    const char *const *extensions;
    /* Stores the bound of everything that it makes. Returns 0 when the bound is unknown. May be NULL. */
    int (*bound) (const char *params, float *bound);
    /* Makes the scene calls. Returns 0, or another number with a text in `message` (of `size` bytes). */
    int (*run) (const gelato_calls *calls, void *self, const char *params, char *message, size_t size);
} gelato_generator;

/* ---- Images ---- */

/* The numbers are those of ImageIOFormatSpec. `format` is a ParamBaseType. */
typedef struct gelato_image_spec {
    int x, y, z, width, height, depth, full_width, full_height, full_depth;
    int tile_width, tile_height, tile_depth, nchannels, format;
    /* `nchannels` names, or NULL. */
    const char *const *channelnames;
} gelato_image_spec;

typedef struct gelato_image_parameter {
    const char *name;
    int type;     /* a ParamBaseType */
    int nvalues;
    const void *value;
} gelato_image_parameter;

enum gelato_image_feature {
    GELATO_IMAGE_TILES = 1, GELATO_IMAGE_RANDOM_ACCESS = 2, GELATO_IMAGE_MULTIIMAGE = 4, GELATO_IMAGE_VOLUMES = 8,
    GELATO_IMAGE_REWRITE = 16, GELATO_IMAGE_EMPTY = 32, GELATO_IMAGE_RECTANGLES = 64
};

/* The result of functions of images. The last two come with a text, if the plugin has one. */
enum gelato_status { GELATO_OK = 0, GELATO_FAILED = 1, GELATO_THREW = 2 };

/* Space for a text that ends with 0. */
typedef struct gelato_message {
    char *text;
    size_t size;
} gelato_message;

/* A writer. Strides are numbers of floats. NAME.imageio.so exports `int imageio_abi = GELATO_C_ABI;` and
   `const gelato_image_output_calls *NAME_output_imageio_c (void);`, and optionally NAME_output_extensions. */
typedef struct gelato_image_output_calls {
    int abi;
    /* Returns a new object, or NULL. `factory` is NULL. */
    void *(*create) (void *factory, gelato_message message);
    int (*supports) (void *self);
    int (*open) (void *self, const char *name, const gelato_image_spec *spec, int nparams,
                 const gelato_image_parameter *params, int append, gelato_message message);
    int (*write_scanline) (void *self, int y, int z, const float *data, int xstride, gelato_message message);
    int (*write_tile) (void *self, int x, int y, int z, const float *data, int xstride, int ystride, int zstride,
                       gelato_message message);
    /* Is called instead of write_scanline, in any order, for formats with GELATO_IMAGE_RECTANGLES. The ends are part of
       the rectangle. May be NULL. */
    int (*write_rectangle) (void *self, int xmin, int xmax, int ymin, int ymax, const float *data, int xstride,
                            int ystride, gelato_message message);
    int (*close) (void *self, gelato_message message);
    void (*destroy) (void *self);
} gelato_image_output_calls;

/* A reader. NAME.imageio.so exports `const gelato_image_input_calls *NAME_input_imageio_c (void);`, and optionally
   NAME_input_extensions. Channel names in `spec` are valid until the next call. */
typedef struct gelato_image_input_calls {
    int abi;
    void *(*create) (void *factory, gelato_message message);
    int (*open) (void *self, const char *name, gelato_image_spec *spec, gelato_message message);
    int (*seek_subimage) (void *self, int index, gelato_image_spec *spec, gelato_message message);
    int (*read_native_scanline) (void *self, int y, int z, void *data, gelato_message message);
    int (*read_native_tile) (void *self, int x, int y, int z, void *data, gelato_message message);
    int (*read_scanline) (void *self, int y, int z, float *data, int xstride, gelato_message message);
    int (*read_tile) (void *self, int x, int y, int z, float *data, int xstride, int ystride, int zstride,
                      gelato_message message);
    /* `type` holds the bits of a ParamType. */
    int (*get_parameter) (void *self, const char *name, unsigned int type, void *value, gelato_message message);
    int (*close) (void *self, gelato_message message);
    void (*destroy) (void *self);
} gelato_image_input_calls;

/* ---- Shadeops ---- */

/* An argument or symbol. The values of point i begin `i * stride` items after `data`. Items are floats or char
   pointers. `type` holds the bits of a ParamType. */
typedef struct gelato_argument {
    void *data;
    int stride;
    int varying;
    unsigned int type;
    int item_bytes;
} gelato_argument;

typedef struct gelato_execution gelato_execution;
typedef struct gelato_execution_calls {
    int abi;
    int (*forcevarying) (gelato_execution *self, int argument);
    const char *(*tokenize) (gelato_execution *self, const char *text);
    void (*error) (gelato_execution *self, const char *text);
    /* `what` is 0 for texture, with (s, t, dsdx, dtdx, dsdy, dtdy) in `at`; 1 for shadow, with P, dPdx, dPdy; and 2 for
       environment, with R, dRdx, dRdy. */
    void (*lookup) (gelato_execution *self, int what, const char *filename, int firstchannel, int nchannels,
                    const float *at, float *result, int nparams, const char *const *names, void *const *data);
    int (*gettextureinfo) (gelato_execution *self, const char *texture, const char *name, unsigned int type, void *result);
    int (*getattribute) (gelato_execution *self, const char *name, unsigned int type, void *result);
    /* Returns the index of the symbol among the arguments, or -1. */
    int (*getsymbol) (gelato_execution *self, const char *name);
} gelato_execution_calls;

/* The run of a shader. This is the beginning of every ShadingExecution. */
struct gelato_execution {
    const gelato_execution_calls *calls;
    const short *active;
    gelato_argument *arguments;
    int begin, end;
    int raylevel, isshadowray, isindirectray;
};

/* The kinds of noise. `period` is used only by the periodic ones. */
enum gelato_noise_kind { GELATO_NOISE = 0, GELATO_SNOISE, GELATO_CNOISE, GELATO_PNOISE, GELATO_PSNOISE };
typedef void (*gelato_noise_function) (int kind, int indim, const float *in, const float *period, int outdim, float *out);

/* ---- libgelato and libgsoargs: needed by programs, not by plugins ---- */

/* Returns a GelatoAPI; NULL when it cannot be made. The message then goes to `errors`, or to standard error. */
void *gelato_create_renderer (const char *type, gelato_errors *errors);
gelato_errors *gelato_create_errors (void *handler, int verbosity);
/* Return an ImageOutput or ImageInput, which the caller deletes. NULL on failure; see gelato_image_error. */
void *gelato_make_image_output (const char *filename, const char *format, const char *searchpath);
void *gelato_make_image_input (const char *filename, const char *searchpath);
/* Returns the reason of the last failure of these two in this thread. */
const char *gelato_image_error (void);

/* The parameters of a compiled shader. */
typedef struct gelato_shader gelato_shader;
typedef struct gelato_shader_parameter {
    const char *name;
    unsigned int type;   /* bits of a ParamType */
    int isoutput, valid, varlenarray;
    int nfloats, nstrings, nspaces, nmetadata;
    const float *floats;
    const char *const *strings;
    const char *const *spaces;
    const struct gelato_shader_parameter *metadata;
} gelato_shader_parameter;
typedef struct gelato_shader_view {
    const char *name, *type, *error;   /* `error` is NULL on success */
    int nparameters, nmetadata;
    const gelato_shader_parameter *parameters;
    const gelato_shader_parameter *metadata;
} gelato_shader_view;
/* Never returns NULL. The caller passes the result to gelato_shader_close. */
gelato_shader *gelato_shader_open (const char *name, const char *searchpath, gelato_shader_view *view);
void gelato_shader_close (gelato_shader *shader);

#ifdef __cplusplus
}
#endif

#endif
