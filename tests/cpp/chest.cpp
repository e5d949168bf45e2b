// A format with floats in tiles or scanlines, and several images in a file. Files are read and written as a whole.
#include <stdio.h>

#include "imageio.h"

using namespace Gelato;

struct Image {
    int head[7]; // width, height, full width, full height, tile width, tile height, channels
    std::vector<float> data;
};

static const char magic[] = "chest1";

static size_t values (const int *h)
{
    int w = h[4] ? (h[0] + h[4] - 1) / h[4] * h[4] : h[0], rows = h[5] ? (h[1] + h[5] - 1) / h[5] * h[5] : h[1];
    return (size_t) w * rows * h[6];
}

class ChestOutput : public ImageOutput {
public:
    bool supports_tiles () const { return true; }
    bool supports_multiimage () const { return true; }
    bool supports_random_access () const { return true; }
    bool open (const char *n, const ImageIOFormatSpec &s, int, const ImageIOParameter *, bool append) {
        if (! append)
            all.clear ();
        name = n;
        Image p;
        const int head[7] = { s.width, s.height, s.full_width, s.full_height, s.tile_width, s.tile_height, s.nchannels };
        memcpy (p.head, head, sizeof(head));
        p.data.resize (values (head));
        all.push_back (p);
        return true;
    }
    bool write_scanline (int y, int, const float *data, int xstride) {
        Image &p = all.back ();
        for (int x = 0; x < p.head[0]; ++x)
            memcpy (&p.data[((size_t) y * p.head[0] + x) * p.head[6]], data + x * xstride, p.head[6] * sizeof(float));
        return true;
    }
    bool write_tile (int x, int y, int, const float *data, int xstride, int ystride, int) {
        Image &p = all.back ();
        const int *h = p.head;
        int across = (h[0] + h[4] - 1) / h[4];
        float *to = &p.data[(size_t) (y / h[5] * across + x / h[4]) * h[4] * h[5] * h[6]];
        for (int j = 0; j < h[5]; ++j)
            for (int i = 0; i < h[4]; ++i, to += h[6])
                memcpy (to, data + j * ystride + i * xstride, h[6] * sizeof(float));
        return true;
    }
    bool close () {
        FILE *f = fopen (name.c_str (), "wb");
        if (! f) {
            error ("cannot write %s", name.c_str ());
            return false;
        }
        int n = (int) all.size ();
        fwrite (magic, 1, sizeof(magic), f);
        fwrite (&n, sizeof(n), 1, f);
        for (int i = 0; i < n; ++i) {
            fwrite (all[i].head, sizeof(all[i].head), 1, f);
            fwrite (&all[i].data[0], sizeof(float), all[i].data.size (), f);
        }
        return fclose (f) == 0;
    }
private:
    std::string name;
    std::vector<Image> all;
};

class ChestInput : public ImageInput {
public:
    bool open (const char *name, ImageIOFormatSpec &newspec, int, const ImageIOParameter *) {
        FILE *f = fopen (name, "rb");
        char m[sizeof(magic)] = "";
        int n = 0;
        if (! f || fread (m, sizeof(m), 1, f) != 1 || memcmp (m, magic, sizeof(m)) || fread (&n, sizeof(n), 1, f) != 1) {
            if (f)
                fclose (f);
            error ("not a chest");
            return false;
        }
        for (int i = 0; i < n; ++i) {
            Image p;
            if (fread (p.head, sizeof(p.head), 1, f) != 1)
                break;
            p.data.resize (values (p.head));
            if (fread (&p.data[0], sizeof(float), p.data.size (), f) != p.data.size ())
                break;
            all.push_back (p);
        }
        fclose (f);
        return seek_subimage (0, newspec);
    }
    int current_subimage () const { return now; }
    bool seek_subimage (int index, ImageIOFormatSpec &newspec) {
        if (index < 0 || index >= (int) all.size ())
            return false;
        now = index;
        const int *h = all[now].head;
        spec.width = h[0], spec.height = h[1], spec.depth = 1, spec.full_width = h[2], spec.full_height = h[3];
        spec.full_depth = 1, spec.tile_width = h[4], spec.tile_height = h[5], spec.tile_depth = 1, spec.nchannels = h[6];
        spec.format = PT_FLOAT;
        spec.channelnames.clear ();
        static const char *names[4] = { "R", "G", "B", "A" };
        for (int c = 0; c < h[6]; ++c)
            spec.channelnames.push_back (c < 4 ? names[c] : "more");
        newspec = spec;
        return true;
    }
    bool read_native_scanline (int y, int, void *data) {
        const Image &p = all[now];
        size_t n = (size_t) p.head[0] * p.head[6];
        if (p.head[4])
            return false;
        memcpy (data, &p.data[y * n], n * sizeof(float));
        return true;
    }
    bool read_native_tile (int x, int y, int, void *data) {
        const Image &p = all[now];
        const int *h = p.head;
        int across = (h[0] + h[4] - 1) / h[4];
        size_t n = (size_t) h[4] * h[5] * h[6];
        memcpy (data, &p.data[(y / h[5] * across + x / h[4]) * n], n * sizeof(float));
        return true;
    }
    bool get_parameter (const char *name, ParamType t, void *val) {
        if (strcmp (name, "textureformat") || t.basetype != PT_STRING)
            return false;
        *(const char **) val = "Plain Texture";
        return true;
    }
    bool close () { return true; }
private:
    std::vector<Image> all;
    int now;
};

extern "C" {
GELATO_EXPORT int imageio_version = IMAGEIO_VERSION;
GELATO_EXPORT ImageOutput *chest_output_imageio_create () { return new ChestOutput; }
GELATO_EXPORT ImageInput *chest_input_imageio_create () { return new ChestInput; }
GELATO_EXPORT const char *chest_output_extensions[] = { "chs", NULL };
GELATO_EXPORT const char *chest_input_extensions[] = { "chs", NULL };
}
