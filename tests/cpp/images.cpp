// Writes and reads images with MakeImageOutput and MakeImageInput, in a plugin's and bundled formats, by scanlines and
// tiles.
#include "check.h"
#include "imageio.h"

using namespace Gelato;

static ImageIOFormatSpec spec (int width, int height, int tile, ParamBaseType format)
{
    static const char *names[] = { "R", "G", "B" };
    ImageIOFormatSpec s;
    s.x = s.y = s.z = 0;
    s.width = s.full_width = width, s.height = s.full_height = height, s.depth = s.full_depth = 1;
    s.tile_width = s.tile_height = tile, s.tile_depth = tile ? 1 : 0;
    s.nchannels = 3, s.format = format;
    s.channelnames.assign (names, names + 3);
    memset (s.unused, 0, sizeof(s.unused));
    return s;
}

static void scanlines (const char *name, ParamBaseType format)
{
    ImageOutput *out = MakeImageOutput (name, ".");
    if (! out)
        fprintf (stderr, "%s\n", ImageIOErrorMessage ());
    CHECK (out && out->open (name, spec (5, 4, 0, format), 0, NULL));
    float line[5 * 4];
    for (int y = 0; y < 4; ++y) {
        for (int i = 0; i < 20; ++i)
            line[i] = i % 4 == 3 ? 99 : (i % 4 + y) / 8.0f;
        CHECK (out->write_scanline (y, 0, line, 4));
    }
    CHECK (out->close ());
    delete out;
    ImageInput *in = MakeImageInput (name, ".");
    ImageIOFormatSpec s;
    CHECK (in && in->open (name, s, 0, NULL) && s.width == 5 && s.height == 4 && s.nchannels == 3);
    CHECK (! strcmp (s.channelnames[1], "G") && in->current_subimage () == 0);
    float back[15];
    for (int y = 3; y >= 0; --y) {
        CHECK (in->read_scanline (y, 0, back));
        CHECK (fabsf (back[0] - y / 8.0f) < 0.003f && fabsf (back[14] - (2 + y) / 8.0f) < 0.003f);
    }
    CHECK (! in->read_scanline (4, 0, back) || s.format == PT_FLOAT);
    CHECK (in->close ());
    delete in;
}

int main ()
{
    scanlines ("m.tif", PT_UINT8);
    scanlines ("m.png", PT_UINT16);
    scanlines ("m.exr", PT_HALF);
    scanlines ("m.chs", PT_FLOAT);

    ImageOutput *out = MakeImageOutput ("t.tif", "tiff", NULL);
    CHECK (out && out->supports_tiles () && ! out->supports_rectangles ());
    const int quantize[4] = { 0, 65535, 0, 65535 };
    const float none = 0;
    const ImageIOParameter params[] = { ImageIOParameter ("quantize", PT_INT, 4, quantize), ImageIOParameter ("dither", PT_FLOAT, 1, &none) };
    CHECK (out->open ("t.tif", spec (20, 10, 16, PT_UINT16), 2, params));
    std::vector<float> tile (16 * 16 * 3, 0.25f);
    CHECK (out->write_tile (0, 0, 0, &tile[0], 3, 48, 0) && out->write_tile (16, 0, 0, &tile[0], 3, 48, 0));
    CHECK (! out->write_tile (-1, 0, 0, &tile[0], 3, 48, 0) && out->error_message ());
    CHECK (out->close ());
    delete out;
    ImageInput *in = MakeImageInput ("t.tif", "");
    ImageIOFormatSpec s;
    CHECK (in && in->open ("t.tif", s, 0, NULL) && s.format == PT_UINT16 && s.tile_width == 16);
    std::vector<float> back (16 * 16 * 3);
    CHECK (in->read_tile (16, 0, 0, &back[0]) && fabsf (back[0] - 0.25f) < 1e-4f);
    CHECK (! in->seek_subimage (1, s) && in->error_message ());
    delete in;

    CHECK (! MakeImageInput ("nosuch.tif", ".") && strstr (ImageIOErrorMessage (), "nosuch.tif"));
    CHECK (! MakeImageOutput ("a.nosuch", ".") && strstr (ImageIOErrorMessage (), "nosuch"));
    CHECK (! MakeImageOutput (NULL, NULL) && ! MakeImageInput (NULL, NULL));
    return 0;
}
