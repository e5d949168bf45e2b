// Where classes of C++ and the C tables of gelato_c.h meet. No exception gets past it: each call into a plugin or a
// program stands within `guard`. SPDX-License-Identifier: MIT OR Apache-2.0

#include <exception>
#include <new>

#include "gelatoapi.h"
#include "imageio.h"
#include "shadeop.h"

using namespace Gelato;

namespace {

void tell (gelato_message message, const char *text)
{
    if (message.text && message.size)
        snprintf (message.text, message.size, "%s", text ? text : "");
}

// Runs `f`, which says whether it went well.
template <class F> int guard (gelato_message message, F f)
{
    try {
        return f () ? GELATO_OK : GELATO_FAILED;
    } catch (const std::exception &e) {
        tell (message, e.what ());
    } catch (const char *text) {
        tell (message, text);
    } catch (const std::string &text) {
        tell (message, text.c_str ());
    } catch (...) {
        tell (message, "something that is no std::exception");
    }
    return GELATO_THREW;
}

// As guard, with the text that the image keeps.
template <class Image, class F> int guard_image (Image *image, gelato_message message, F f)
{
    return guard (message, [&] {
        bool good = f ();
        if (! good)
            tell (message, image->error_message ());
        return good;
    });
}

template <class Object> void end (Object *object)
{
    guard (gelato_message (), [&] { delete object; return true; });
}

template <class T> unsigned int bits_of (const T &type)
{
    unsigned int bits;
    memcpy (&bits, &type, sizeof(bits));
    return bits;
}

// ---- Image writers ----

template <class Image> void *create_image (void *factory, gelato_message message)
{
    Image *image = NULL;
    guard (message, [&] { image = reinterpret_cast<Image *(*) ()> (factory) (); return true; });
    return image;
}

ImageOutput *output (void *self) { return static_cast<ImageOutput *> (self); }

int output_supports (void *self)
{
    int features = 0;
    guard (gelato_message (), [&] {
        const ImageOutput *o = output (self);
        features = (o->supports_tiles () ? GELATO_IMAGE_TILES : 0)
            | (o->supports_random_access () ? GELATO_IMAGE_RANDOM_ACCESS : 0)
            | (o->supports_multiimage () ? GELATO_IMAGE_MULTIIMAGE : 0)
            | (o->supports_volumes () ? GELATO_IMAGE_VOLUMES : 0)
            | (o->supports_rewrite () ? GELATO_IMAGE_REWRITE : 0)
            | (o->supports_empty () ? GELATO_IMAGE_EMPTY : 0)
            | (o->supports_rectangles () ? GELATO_IMAGE_RECTANGLES : 0);
        return true;
    });
    return features;
}

void to_cpp (const gelato_image_spec &from, ImageIOFormatSpec &to)
{
    to.x = from.x, to.y = from.y, to.z = from.z;
    to.width = from.width, to.height = from.height, to.depth = from.depth;
    to.full_width = from.full_width, to.full_height = from.full_height, to.full_depth = from.full_depth;
    to.tile_width = from.tile_width, to.tile_height = from.tile_height, to.tile_depth = from.tile_depth;
    to.nchannels = from.nchannels;
    to.format = (ParamBaseType) from.format;
    to.channelnames.clear ();
    for (int i = 0; from.channelnames && i < from.nchannels; ++i)
        to.channelnames.push_back (from.channelnames[i]);
    memset (to.unused, 0, sizeof(to.unused));
}

int output_open (void *self, const char *name, const gelato_image_spec *spec, int nparams,
                 const gelato_image_parameter *params, int append, gelato_message message)
{
    return guard_image (output (self), message, [&] {
        ImageIOFormatSpec s;
        to_cpp (*spec, s);
        std::vector<ImageIOParameter> list;
        for (int i = 0; i < nparams; ++i)
            list.push_back (ImageIOParameter (params[i].name, (ParamBaseType) params[i].type,
                                              params[i].nvalues, params[i].value));
        return output (self)->open (name, s, nparams, nparams ? &list[0] : NULL, append != 0);
    });
}

int output_write_scanline (void *self, int y, int z, const float *data, int xstride, gelato_message message)
{
    return guard_image (output (self), message, [&] { return output (self)->write_scanline (y, z, data, xstride); });
}

int output_write_tile (void *self, int x, int y, int z, const float *data, int xstride, int ystride, int zstride,
                       gelato_message message)
{
    return guard_image (output (self), message, [&] {
        return output (self)->write_tile (x, y, z, data, xstride, ystride, zstride);
    });
}

int output_write_rectangle (void *self, int xmin, int xmax, int ymin, int ymax, const float *data, int xstride,
                            int ystride, gelato_message message)
{
    return guard_image (output (self), message, [&] {
        return output (self)->write_rectangle (xmin, xmax, ymin, ymax, 0, 0, data, xstride, ystride,
                                               ystride * (ymax - ymin + 1));
    });
}

int output_close (void *self, gelato_message message)
{
    return guard_image (output (self), message, [&] { return output (self)->close (); });
}

void output_destroy (void *self) { end (output (self)); }

const gelato_image_output_calls output_calls = {
    GELATO_C_ABI, create_image<ImageOutput>, output_supports, output_open, output_write_scanline, output_write_tile,
    output_write_rectangle, output_close, output_destroy
};

// ---- Image readers ----

// A plugin's reader, and the description of its image that the names in a gelato_image_spec belong to.
struct Reader {
    ImageInput *image;
    ImageIOFormatSpec spec;
};

Reader *reader (void *self) { return static_cast<Reader *> (self); }

void clear (ImageIOFormatSpec &spec)
{
    gelato_image_spec nothing;
    memset (&nothing, 0, sizeof(nothing));
    to_cpp (nothing, spec);
}

void *input_create (void *factory, gelato_message message)
{
    ImageInput *image = static_cast<ImageInput *> (create_image<ImageInput> (factory, message));
    if (! image)
        return NULL;
    Reader *r = new (std::nothrow) Reader;
    if (! r) {
        end (image);
        return NULL;
    }
    r->image = image;
    clear (r->spec);
    return r;
}

void to_c (const ImageIOFormatSpec &from, gelato_image_spec *to)
{
    to->x = from.x, to->y = from.y, to->z = from.z;
    to->width = from.width, to->height = from.height, to->depth = from.depth;
    to->full_width = from.full_width, to->full_height = from.full_height, to->full_depth = from.full_depth;
    to->tile_width = from.tile_width, to->tile_height = from.tile_height, to->tile_depth = from.tile_depth;
    to->nchannels = from.nchannels;
    to->format = from.format;
    bool named = from.nchannels > 0 && from.channelnames.size () >= (size_t) from.nchannels;
    to->channelnames = named ? &from.channelnames[0] : NULL;
}

int input_open (void *self, const char *name, gelato_image_spec *spec, gelato_message message)
{
    Reader *r = reader (self);
    clear (r->spec);
    int status = guard_image (r->image, message, [&] { return r->image->open (name, r->spec, 0, NULL); });
    to_c (r->spec, spec);
    return status;
}

int input_seek_subimage (void *self, int index, gelato_image_spec *spec, gelato_message message)
{
    Reader *r = reader (self);
    int status = guard_image (r->image, message, [&] { return r->image->seek_subimage (index, r->spec); });
    to_c (r->spec, spec);
    return status;
}

int input_read_native_scanline (void *self, int y, int z, void *data, gelato_message message)
{
    Reader *r = reader (self);
    return guard_image (r->image, message, [&] { return r->image->read_native_scanline (y, z, data); });
}

int input_read_native_tile (void *self, int x, int y, int z, void *data, gelato_message message)
{
    Reader *r = reader (self);
    return guard_image (r->image, message, [&] { return r->image->read_native_tile (x, y, z, data); });
}

int input_read_scanline (void *self, int y, int z, float *data, int xstride, gelato_message message)
{
    Reader *r = reader (self);
    return guard_image (r->image, message, [&] { return r->image->read_scanline (y, z, data, xstride); });
}

int input_read_tile (void *self, int x, int y, int z, float *data, int xstride, int ystride, int zstride,
                     gelato_message message)
{
    Reader *r = reader (self);
    return guard_image (r->image, message, [&] {
        return r->image->read_tile (x, y, z, data, xstride, ystride, zstride);
    });
}

int input_get_parameter (void *self, const char *name, unsigned int type, void *value, gelato_message message)
{
    Reader *r = reader (self);
    return guard_image (r->image, message, [&] {
        ParamType t;
        memcpy ((void *) &t, &type, sizeof(t));
        return r->image->get_parameter (name, t, value);
    });
}

int input_close (void *self, gelato_message message)
{
    Reader *r = reader (self);
    return guard_image (r->image, message, [&] { return r->image->close (); });
}

void input_destroy (void *self)
{
    end (reader (self)->image);
    delete reader (self);
}

const gelato_image_input_calls input_calls = {
    GELATO_C_ABI, input_create, input_open, input_seek_subimage, input_read_native_scanline, input_read_native_tile,
    input_read_scanline, input_read_tile, input_get_parameter, input_close, input_destroy
};

// ---- Images that are written and read elsewhere, as classes ----

// A text of a table's function becomes the image's own.
template <class Image, class F> bool through (Image *image, F f)
{
    char text[1024] = "";
    const gelato_message message = { text, sizeof(text) };
    bool good = f (message) == GELATO_OK;
    if (! good)
        image->error ("%s", text);
    return good;
}

class TableOutput : public ImageOutput {
public:
    TableOutput (const gelato_image_output_calls *calls, void *self) : calls (calls), self (self) {}
    ~TableOutput () { calls->destroy (self); }

    bool supports_tiles () const { return can (GELATO_IMAGE_TILES); }
    bool supports_random_access () const { return can (GELATO_IMAGE_RANDOM_ACCESS); }
    bool supports_multiimage () const { return can (GELATO_IMAGE_MULTIIMAGE); }
    bool supports_volumes () const { return can (GELATO_IMAGE_VOLUMES); }
    bool supports_rewrite () const { return can (GELATO_IMAGE_REWRITE); }
    bool supports_empty () const { return can (GELATO_IMAGE_EMPTY); }
    bool supports_rectangles () const { return can (GELATO_IMAGE_RECTANGLES); }

    bool open (const char *name, const ImageIOFormatSpec &spec, int nparams, const ImageIOParameter *param,
               bool append) {
        gelato_image_spec s;
        to_c (spec, &s);
        std::vector<gelato_image_parameter> list;
        for (int i = 0; i < nparams; ++i) {
            const gelato_image_parameter p = { param[i].name, param[i].type, param[i].nvalues, param[i].value };
            list.push_back (p);
        }
        return through (this, [&] (gelato_message m) {
            return calls->open (self, name, &s, nparams, nparams ? &list[0] : NULL, append, m);
        });
    }
    bool write_scanline (int y, int z, const float *data, int xstride) {
        return through (this, [&] (gelato_message m) { return calls->write_scanline (self, y, z, data, xstride, m); });
    }
    bool write_tile (int x, int y, int z, const float *data, int xstride, int ystride, int zstride) {
        return through (this, [&] (gelato_message m) {
            return calls->write_tile (self, x, y, z, data, xstride, ystride, zstride, m);
        });
    }
    bool write_rectangle (int xmin, int xmax, int ymin, int ymax, int, int, const float *data, int xstride,
                          int ystride, int) {
        return calls->write_rectangle && through (this, [&] (gelato_message m) {
            return calls->write_rectangle (self, xmin, xmax, ymin, ymax, data, xstride, ystride, m);
        });
    }
    bool close () {
        return through (this, [&] (gelato_message m) { return calls->close (self, m); });
    }

private:
    bool can (int feature) const { return (calls->supports (self) & feature) != 0; }
    const gelato_image_output_calls *calls;
    void *self;
};

class TableInput : public ImageInput {
public:
    TableInput (const gelato_image_input_calls *calls, void *self) : calls (calls), self (self), image (0) {}
    ~TableInput () { calls->destroy (self); }

    bool open (const char *name, ImageIOFormatSpec &newspec, int, const ImageIOParameter *) {
        return described (newspec, [&] (gelato_image_spec *s, gelato_message m) {
            return calls->open (self, name, s, m);
        }, 0);
    }
    int current_subimage () const { return image; }
    bool seek_subimage (int index, ImageIOFormatSpec &newspec) {
        return described (newspec, [&] (gelato_image_spec *s, gelato_message m) {
            return calls->seek_subimage (self, index, s, m);
        }, index);
    }
    bool read_native_scanline (int y, int z, void *data) {
        return through (this, [&] (gelato_message m) { return calls->read_native_scanline (self, y, z, data, m); });
    }
    bool read_native_tile (int x, int y, int z, void *data) {
        return through (this, [&] (gelato_message m) { return calls->read_native_tile (self, x, y, z, data, m); });
    }
    bool get_parameter (const char *name, ParamType t, void *val) {
        return calls->get_parameter && through (this, [&] (gelato_message m) {
            return calls->get_parameter (self, name, bits_of (t), val, m);
        });
    }
    bool close () {
        return through (this, [&] (gelato_message m) { return calls->close (self, m); });
    }

private:
    template <class F> bool described (ImageIOFormatSpec &newspec, F f, int index) {
        gelato_image_spec s;
        memset (&s, 0, sizeof(s));
        bool good = through (this, [&] (gelato_message m) { return f (&s, m); });
        if (good) {
            to_cpp (s, spec);
            newspec = spec;
            image = index;
        }
        return good;
    }
    const gelato_image_input_calls *calls;
    void *self;
    int image;
};

// ---- A renderer for programs and generators ----

class HostRenderer : public GelatoAPI {
public:
    HostRenderer (const gelato_calls *calls, void *self) : calls (calls), self (self) {}
    ~HostRenderer () {
        if (calls->destroy)
            calls->destroy (self);
    }

    void Input (const char *filename) { words (GELATO_INPUT, filename); }
    void Input (const char *filename, const float *bound) {
        if (bound)
            calls->numbers (self, GELATO_INPUT_BOUND, 6, bound, filename);
        else
            words (GELATO_INPUT, filename);
    }
    void Input (Generator *procedure, const float *boundingbox) {
        calls->input_generator (self, procedure, boundingbox);
    }

    void Camera (const char *name) { words (GELATO_CAMERA, name); }
    void Output (const char *name, const char *format, const char *dataname, const char *cameraname) {
        words (GELATO_OUTPUT, name, format, dataname, cameraname);
    }
    void World () { words (GELATO_WORLD); }
    void Render (const char *cameraname) { words (GELATO_RENDER, cameraname); }

    // The last named parameter is a float, by the interface; compilers handle it.
#if defined(__clang__)
#pragma clang diagnostic push
#pragma clang diagnostic ignored "-Wvarargs"
#endif
    void Motion (int ntimes, float time0, ...) {
        if (ntimes < 1 || ntimes > 1000)
            return numbers (GELATO_MOTION, 0, NULL);
        std::vector<float> times (1, time0);
        va_list more;
        va_start (more, time0);
        for (int i = 1; i < ntimes; ++i)
            times.push_back ((float) va_arg (more, double));
        va_end (more);
        numbers (GELATO_MOTION, ntimes, &times[0]);
    }
#if defined(__clang__)
#pragma clang diagnostic pop
#endif
    void Motion (int ntimes, const float *times) { numbers (GELATO_MOTION, times ? ntimes : 0, times); }

    void Comment (const char *format, ...) {
        va_list values;
        va_start (values, format);
        std::string text = gelato_format (format, values);
        va_end (values);
        words (GELATO_COMMENT, text.c_str ());
    }

    void Command (const char *command) { words (GELATO_COMMAND, command); }

#define GELATO_VALUES(call, attribute) \
    void call (const char *n, ParamType t, const void *v) { value (attribute, n, &t, GELATO_ANY, v); } \
    void call (const char *n, ParamType t, int v) { value (attribute, n, &t, GELATO_INT, &v); } \
    void call (const char *n, ParamType t, float v) { value (attribute, n, &t, GELATO_FLOAT, &v); } \
    void call (const char *n, ParamType t, double v) { value (attribute, n, &t, GELATO_DOUBLE, &v); } \
    void call (const char *n, ParamType t, const char *v) { value (attribute, n, &t, GELATO_STRING, v); } \
    void call (const char *n, ParamType t, const int *v) { value (attribute, n, &t, GELATO_INTS, v); } \
    void call (const char *n, ParamType t, const float *v) { value (attribute, n, &t, GELATO_FLOATS, v); } \
    void call (const char *n, ParamType t, const char **v) { value (attribute, n, &t, GELATO_STRINGS, v); } \
    void call (const char *n, const void *v) { value (attribute, n, NULL, GELATO_ANY, v); } \
    void call (const char *n, int v) { value (attribute, n, NULL, GELATO_INT, &v); } \
    void call (const char *n, float v) { value (attribute, n, NULL, GELATO_FLOAT, &v); } \
    void call (const char *n, double v) { value (attribute, n, NULL, GELATO_DOUBLE, &v); } \
    void call (const char *n, const char *v) { value (attribute, n, NULL, GELATO_STRING, v); } \
    void call (const char *n, const int *v) { value (attribute, n, NULL, GELATO_INTS, v); } \
    void call (const char *n, const float *v) { value (attribute, n, NULL, GELATO_FLOATS, v); } \
    void call (const char *n, const char **v) { value (attribute, n, NULL, GELATO_STRINGS, v); }
    GELATO_VALUES (Parameter, 0)
    GELATO_VALUES (Attribute, 1)
#undef GELATO_VALUES

    bool GetAttribute (const char *n, void *v) { return get (n, GELATO_ANY, v); }
    bool GetAttribute (const char *n, int &v) { return get (n, GELATO_INT, &v); }
    bool GetAttribute (const char *n, float &v) { return get (n, GELATO_FLOAT, &v); }
    bool GetAttribute (const char *n, double &v) { return get (n, GELATO_DOUBLE, &v); }
    bool GetAttribute (const char *n, char *&v) { return get (n, GELATO_STRING, &v); }
    bool GetAttribute (const char *n, int *v) { return get (n, GELATO_INTS, v); }
    bool GetAttribute (const char *n, float *v) { return get (n, GELATO_FLOATS, v); }
    bool GetAttribute (const char *n, char **v) { return get (n, GELATO_STRINGS, v); }

    void PushAttributes () { words (GELATO_PUSH_ATTRIBUTES); }
    void PopAttributes () { words (GELATO_POP_ATTRIBUTES); }
    void SaveAttributes (const char *name, const char *attrs) { words (GELATO_SAVE_ATTRIBUTES, name, attrs); }
    void RestoreAttributes (const char *name, const char *attrs) { words (GELATO_RESTORE_ATTRIBUTES, name, attrs); }
    void Modify (const char *namepattern) { words (GELATO_MODIFY, namepattern); }

    void PushTransform () { words (GELATO_PUSH_TRANSFORM); }
    void PopTransform () { words (GELATO_POP_TRANSFORM); }
    void SetTransform (const float *M) { numbers (GELATO_SET_TRANSFORM, 16, M); }
    void SetTransform (const char *spacename) { words (GELATO_SET_TRANSFORM_NAMED, spacename); }
    void AppendTransform (const float *M) { numbers (GELATO_APPEND_TRANSFORM, 16, M); }
    void Translate (float x, float y, float z) {
        const float v[] = { x, y, z };
        numbers (GELATO_TRANSLATE, 3, v);
    }
    void Rotate (float angle, float x, float y, float z) {
        const float v[] = { angle, x, y, z };
        numbers (GELATO_ROTATE, 4, v);
    }
    void Scale (float x, float y, float z) {
        const float v[] = { x, y, z };
        numbers (GELATO_SCALE, 3, v);
    }

    void Shader (const char *usage, const char *name, const char *layer) { words (GELATO_SHADER, usage, name, layer); }
    void Light (const char *id, const char *name, const char *layer) { words (GELATO_LIGHT, id, name, layer); }
    void ShaderGroupBegin () { words (GELATO_SHADER_GROUP_BEGIN); }
    void ShaderGroupEnd () { words (GELATO_SHADER_GROUP_END); }
    void ConnectShaders (const char *a, const char *b, const char *c, const char *d) {
        words (GELATO_CONNECT_SHADERS, a, b, c, d);
    }
    void LightSwitch (const char *lightid, bool on) { calls->light_switch (self, lightid, on); }

    void Points (int npoints) { calls->points (self, npoints); }
    void Curves (const char *interp, int ncurves, int nverts) { calls->curves (self, interp, ncurves, nverts); }
    void Curves (int ncurves, int nverts, int order, const float *knot, float vmin, float vmax) {
        const gelato_knots knots = { nverts, order, knot, vmin, vmax };
        calls->nurbs_curves (self, ncurves, &knots);
    }
    void Patch (const char *interp, int nu, int nv) { calls->patch (self, interp, nu, nv); }
    void Patch (int nu, int uorder, const float *uknot, float umin, float umax,
                int nv, int vorder, const float *vknot, float vmin, float vmax) {
        const gelato_knots u = { nu, uorder, uknot, umin, umax }, v = { nv, vorder, vknot, vmin, vmax };
        calls->nurbs_patch (self, &u, &v);
    }
    void TrimCurve (int nloops, const int *ncurves, const int *n, const int *order, const float *knot,
                    const float *min, const float *max, const float *uvw) {
        calls->trim_curve (self, nloops, ncurves, n, order, knot, min, max, uvw);
    }
    void Mesh (const char *interp, int nfaces, const int *nverts, const int *verts) {
        calls->mesh (self, interp, nfaces, nverts, verts);
    }
    void Sphere (float radius, float zmin, float zmax, float thetamax) {
        const float v[] = { radius, zmin, zmax, thetamax };
        numbers (GELATO_SPHERE, 4, v);
    }
    void Sphere (float radius) { Sphere (radius, -radius, radius, 360); }

    ErrorManager &Err () { return *reinterpret_cast<ErrorManager *> (calls->errors (self)); }

private:
    void words (int call, const char *a = NULL, const char *b = NULL, const char *c = NULL, const char *d = NULL) {
        calls->words (self, call, a, b, c, d);
    }
    void numbers (int call, int n, const float *values) { calls->numbers (self, call, n, values, NULL); }
    void value (int attribute, const char *name, const ParamType *type, int kind, const void *data) {
        calls->value (self, attribute, name, type ? bits_of (*type) : 0, kind, data);
    }
    bool get (const char *name, int kind, void *value) { return calls->get_attribute (self, name, kind, value) != 0; }

    const gelato_calls *calls;
    void *self;
};

} // namespace

extern "C" {

const gelato_image_output_calls *gelato_shim_output () { return &output_calls; }
const gelato_image_input_calls *gelato_shim_input () { return &input_calls; }

// The classes over tables; NULL without memory, and `self` stays the caller's then.
void *gelato_shim_table_output (const gelato_image_output_calls *calls, void *self)
{
    return static_cast<ImageOutput *> (new (std::nothrow) TableOutput (calls, self));
}

void *gelato_shim_table_input (const gelato_image_input_calls *calls, void *self)
{
    return static_cast<ImageInput *> (new (std::nothrow) TableInput (calls, self));
}

// Whether a reader has conversions of its own, rather than those that it inherits at these addresses.
int gelato_shim_converts (void *self, void *base_scanline, void *base_tile)
{
#if defined(_WIN32)
    return 1;
#else
    // Behind the two destructors: open, current_subimage, seek_subimage, read_scanline, read_tile.
    void *const *functions = *reinterpret_cast<void *const *const *> (reader (self)->image);
    return functions[5] != base_scanline || functions[6] != base_tile;
#endif
}

// A GelatoAPI, to be deleted by its owner; it destroys what it passes calls to.
void *gelato_shim_renderer (const gelato_calls *calls, void *self)
{
    return static_cast<GelatoAPI *> (new (std::nothrow) HostRenderer (calls, self));
}

void *gelato_shim_generator_create (void *factory, const char *command, gelato_message message)
{
    GelatoAPI::Generator *made = NULL;
    guard (message, [&] {
        made = reinterpret_cast<GelatoAPI::Generator *(*) (const char *)> (factory) (command);
        return true;
    });
    return made;
}

int gelato_shim_generator_bound (void *generator, float *bound, gelato_message message)
{
    return guard (message, [&] { return static_cast<GelatoAPI::Generator *> (generator)->bound (bound); });
}

// `calls` has no destroy here: the receiver is the caller's.
int gelato_shim_generator_run (void *generator, const gelato_calls *calls, void *self, const char *params,
                               gelato_message message)
{
    return guard (message, [&] {
        HostRenderer renderer (calls, self);
        static_cast<GelatoAPI::Generator *> (generator)->run (&renderer, params);
        return true;
    });
}

void gelato_shim_generator_destroy (void *generator) { end (static_cast<GelatoAPI::Generator *> (generator)); }

int gelato_shim_handle (void *handler, int code, const char *text, gelato_message message)
{
    return guard (message, [&] { (*static_cast<ErrorHandler *> (handler)) ((ErrCode) code, text); return true; });
}

int gelato_shim_shadeop (void *function, gelato_execution *execution, int nargs, const int *args,
                         gelato_message message)
{
    return guard (message, [&] {
        typedef void (*Shadeop) (ShadingExecution *, int, const ShaderArg *);
        reinterpret_cast<Shadeop> (function) (reinterpret_cast<ShadingExecution *> (execution), nargs,
                                              reinterpret_cast<const ShaderArg *> (args));
        return true;
    });
}

} // extern "C"
