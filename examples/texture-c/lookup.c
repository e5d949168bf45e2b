/* Looks up a texture at the pixels of a small image, and prints it as characters.

   cc -o lookup lookup.c -I$GELATOHOME/include -L$GELATOHOME/lib -lgranita_texture -Wl,-rpath,$GELATOHOME/lib
   ./lookup TEXTURE */

#include <stdio.h>

#include "granita_texture.h"

#define WIDTH 64
#define HEIGHT 24

/* A point as this program keeps it. Lookups take it as it is, by its strides. */
typedef struct {
    float s, t;
    float value;
} pixel;

static pixel image[HEIGHT][WIDTH];

static int failed (const char *what)
{
    fprintf (stderr, "%s: %s\n", what, granita_texture_error ());
    return 1;
}

int main (int argc, char **argv)
{
    granita_texture_settings settings = { GRANITA_TEXTURE_ABI };
    granita_texture_system *system;
    granita_texture_handle texture;
    granita_texture_info info;
    granita_texture_points points = { 0 };
    granita_texture_lookup2d lookup = { { 0 } };
    const float dsdx = 1.0f / WIDTH, dtdy = 1.0f / HEIGHT;
    char *text;
    int x, y;

    if (argc != 2) {
        fprintf (stderr, "usage: lookup TEXTURE\n");
        return 2;
    }
    settings.memory = 16 << 20;
    settings.threads = -1;
    system = granita_texture_create (&settings);
    if (! system)
        return failed ("granita_texture_create");
    texture = granita_texture_open (system, argv[1]);
    if (! texture)
        return failed ("granita_texture_open");
    if (granita_texture_get_info (system, texture, &info))
        return failed ("granita_texture_get_info");
    printf ("%d x %d, %d channels of %s, %d levels\n", info.width, info.height, info.channels, info.format,
            info.levels);

    for (y = 0; y < HEIGHT; ++y)
        for (x = 0; x < WIDTH; ++x) {
            image[y][x].s = (x + 0.5f) / WIDTH;
            image[y][x].t = (y + 0.5f) / HEIGHT;
        }
    points.columns = WIDTH;
    points.rows = HEIGHT;
    points.channels = 1;
    points.result = &image[0][0].value;
    points.step = sizeof (pixel);
    points.row_step = sizeof (image[0]);
    lookup.s.data = &image[0][0].s;
    lookup.t.data = &image[0][0].t;
    lookup.s.step = lookup.t.step = sizeof (pixel);
    lookup.s.row_step = lookup.t.row_step = sizeof (image[0]);
    /* The steps are 0: one number for all points. */
    lookup.dsdx.data = &dsdx;
    lookup.dtdy.data = &dtdy;
    if (granita_texture_lookup_2d (system, texture, &points, &lookup))
        return failed ("granita_texture_lookup_2d");

    for (y = 0; y < HEIGHT; ++y) {
        for (x = 0; x < WIDTH; ++x) {
            const float value = image[y][x].value;
            const int level = value <= 0 ? 0 : value >= 1 ? 9 : (int) (10 * value);
            putchar (" .:-=+*#%@"[level]);
        }
        putchar ('\n');
    }
    text = granita_texture_messages (system);
    if (text)
        fprintf (stderr, "%s\n", text);
    granita_texture_free (text);
    granita_texture_destroy (system);
    return 0;
}
