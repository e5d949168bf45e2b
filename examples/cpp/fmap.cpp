// An image format: float maps, bottom row first. fmap.imageio.so reads and writes "fmap".
//     g++ -shared -fPIC -o fmap.imageio.so -I$GELATOHOME/include fmap.cpp
#include <stdio.h>

#include "imageio.h"

using namespace Gelato;

class FmapOutput : public ImageOutput {
public:
    FmapOutput () : file (NULL) {}
    ~FmapOutput () {
        if (file)
            fclose (file);
    }
    bool supports_random_access () const { return true; }

    bool open (const char *name, const ImageIOFormatSpec &s, int nparams, const ImageIOParameter *param, bool append) {
        if (append || (s.nchannels != 1 && s.nchannels < 3)) {
            error ("one or three channels fit, not %d", s.nchannels);
            return false;
        }
        file = fopen (name, "wb");
        if (! file) {
            error ("cannot write %s", name);
            return false;
        }
        y = s.y, width = s.width, height = s.height;
        channels = s.nchannels == 1 ? 1 : 3;
        gain = invgamma = 1;
        int index;
        if (const void *v = IOParamFindValue ("gain", PT_FLOAT, 1, index, nparams, param))
            gain = *(const float *) v;
        if (const void *v = IOParamFindValue ("gamma", PT_FLOAT, 1, index, nparams, param))
            invgamma = 1 / *(const float *) v;
        begin = fprintf (file, "P%c\n%d %d\n-1.0\n", channels == 1 ? 'f' : 'F', width, height);
        return begin > 0;
    }
    bool write_scanline (int row, int, const float *data, int xstride) {
        std::vector<float> line (width * channels);
        for (int x = 0; x < width; ++x)
            for (int c = 0; c < channels; ++c)
                line[x * channels + c] = exposure (data[x * xstride + c], gain, invgamma);
        long at = (long) (height - 1 - (row - y)) * width * channels * sizeof(float);
        return fseek (file, begin + at, SEEK_SET) == 0
            && fwrite (&line[0], sizeof(float), line.size (), file) == line.size ();
    }
    bool close () {
        bool good = fclose (file) == 0;
        file = NULL;
        return good;
    }
private:
    FILE *file;
    int y, width, height, channels, begin;
    float gain, invgamma;
};

class FmapInput : public ImageInput {
public:
    FmapInput () : file (NULL) {}
    ~FmapInput () { close (); }

    bool open (const char *name, ImageIOFormatSpec &newspec, int, const ImageIOParameter *) {
        char kind;
        float scale;
        file = fopen (name, "rb");
        if (! file || fscanf (file, "P%c %d %d %f%*c", &kind, &spec.width, &spec.height, &scale) != 4
            || (kind != 'f' && kind != 'F') || scale >= 0) {
            error ("%s is no little-endian float map", name);
            return false;
        }
        begin = ftell (file);
        spec.depth = 1, spec.full_width = spec.width, spec.full_height = spec.height, spec.full_depth = 1;
        spec.nchannels = kind == 'F' ? 3 : 1;
        spec.format = PT_FLOAT;
        static const char *const names[] = { "R", "G", "B" };
        spec.channelnames.assign (names, names + spec.nchannels);
        newspec = spec;
        return true;
    }
    bool read_native_scanline (int row, int, void *data) {
        size_t n = (size_t) spec.width * spec.nchannels;
        return fseek (file, begin + (long) ((spec.height - 1 - row) * n * sizeof(float)), SEEK_SET) == 0
            && fread (data, sizeof(float), n, file) == n;
    }
    bool close () {
        if (file)
            fclose (file);
        file = NULL;
        return true;
    }
private:
    FILE *file;
    long begin;
};

extern "C" {
GELATO_EXPORT int imageio_version = IMAGEIO_VERSION;
GELATO_EXPORT ImageOutput *fmap_output_imageio_create () { return new FmapOutput; }
GELATO_EXPORT ImageInput *fmap_input_imageio_create () { return new FmapInput; }
GELATO_EXPORT const char *fmap_output_extensions[] = { "fmap", NULL };
GELATO_EXPORT const char *fmap_input_extensions[] = { "fmap", NULL };
}
