/* An image format in C, with the tables of gelato_c.h. A file has a line with the size and the names of the channels,
   then floats. It is written in rows, or in rectangles in any order. The end of the file has the number of pieces. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "gelato_c.h"

int imageio_abi = GELATO_C_ABI;
const char *plain_output_extensions[] = { "pln", NULL };
const char *plain_input_extensions[] = { "pln", NULL };

typedef struct Image {
    FILE *file;
    int width, height, n, x, y, rectangles;
    float *pixels;
    char names[8][32];
    const char *pointers[8];
} Image;

static int fail (gelato_message message, const char *text)
{
    snprintf (message.text, message.size, "%s", text);
    return GELATO_FAILED;
}

static void *create (void *factory, gelato_message message)
{
    (void) factory;
    (void) message;
    return calloc (1, sizeof(Image));
}

static void destroy (void *self)
{
    Image *image = (Image *) self;
    if (image->file)
        fclose (image->file);
    free (image->pixels);
    free (image);
}

static int supports (void *self)
{
    (void) self;
    return GELATO_IMAGE_RANDOM_ACCESS | GELATO_IMAGE_RECTANGLES;
}

static int output_open (void *self, const char *name, const gelato_image_spec *spec, int nparams,
                        const gelato_image_parameter *params, int append, gelato_message message)
{
    Image *image = (Image *) self;
    int i;
    (void) nparams;
    (void) params;
    if (append || spec->nchannels > 8)
        return fail (message, "one image of eight channels at most");
    image->file = fopen (name, "wb");
    if (! image->file)
        return fail (message, "cannot be written");
    image->width = spec->width;
    image->height = spec->height;
    image->n = spec->nchannels;
    image->x = spec->x;
    image->y = spec->y;
    image->pixels = (float *) calloc ((size_t) spec->width * spec->height * spec->nchannels, sizeof(float));
    fprintf (image->file, "PLAIN %d %d %d", spec->width, spec->height, spec->nchannels);
    for (i = 0; i < spec->nchannels; ++i)
        fprintf (image->file, " %s", spec->channelnames[i]);
    fprintf (image->file, "\n");
    return GELATO_OK;
}

static int write_rectangle (void *self, int xmin, int xmax, int ymin, int ymax, const float *data, int xstride,
                            int ystride, gelato_message message)
{
    Image *image = (Image *) self;
    int x, y, c;
    if (xmin < image->x || ymin < image->y || xmax >= image->x + image->width || ymax >= image->y + image->height)
        return fail (message, "a rectangle outside of the image");
    for (y = ymin; y <= ymax; ++y)
        for (x = xmin; x <= xmax; ++x)
            for (c = 0; c < image->n; ++c)
                image->pixels[((y - image->y) * image->width + x - image->x) * image->n + c] =
                    data[(y - ymin) * ystride + (x - xmin) * xstride + c];
    ++image->rectangles;
    return GELATO_OK;
}

static int write_scanline (void *self, int y, int z, const float *data, int xstride, gelato_message message)
{
    Image *image = (Image *) self;
    (void) z;
    return write_rectangle (self, image->x, image->x + image->width - 1, y, y, data, xstride, 0, message);
}

static int write_tile (void *self, int x, int y, int z, const float *data, int xstride, int ystride, int zstride,
                       gelato_message message)
{
    (void) self, (void) x, (void) y, (void) z, (void) data, (void) xstride, (void) ystride, (void) zstride;
    return fail (message, "no tiles");
}

static int output_close (void *self, gelato_message message)
{
    Image *image = (Image *) self;
    size_t n = (size_t) image->width * image->height * image->n;
    int whole = fwrite (image->pixels, sizeof(float), n, image->file) == n;
    whole = fprintf (image->file, "pieces %d\n", image->rectangles) > 0 && whole;
    whole = fclose (image->file) == 0 && whole;
    image->file = NULL;
    return whole ? GELATO_OK : fail (message, "the disk is full");
}

static int describe (Image *image, gelato_image_spec *spec)
{
    memset (spec, 0, sizeof(*spec));
    spec->width = spec->full_width = image->width;
    spec->height = spec->full_height = image->height;
    spec->depth = spec->full_depth = 1;
    spec->nchannels = image->n;
    spec->format = 3; /* PT_FLOAT */
    spec->channelnames = image->pointers;
    return GELATO_OK;
}

static int input_open (void *self, const char *name, gelato_image_spec *spec, gelato_message message)
{
    Image *image = (Image *) self;
    size_t n;
    int i;
    image->file = fopen (name, "rb");
    if (! image->file || fscanf (image->file, "PLAIN %d %d %d", &image->width, &image->height, &image->n) != 3
            || image->n < 1 || image->n > 8 || image->width < 1 || image->height < 1 || image->width > 9999
            || image->height > 9999)
        return fail (message, "no plain image");
    for (i = 0; i < image->n; ++i) {
        if (fscanf (image->file, " %31[^ \n]", image->names[i]) != 1)
            return fail (message, "a channel without a name");
        image->pointers[i] = image->names[i];
    }
    fgetc (image->file);
    n = (size_t) image->width * image->height * image->n;
    image->pixels = (float *) malloc (n * sizeof(float));
    if (fread (image->pixels, sizeof(float), n, image->file) != n)
        return fail (message, "it is cut short");
    return describe (image, spec);
}

static int seek_subimage (void *self, int index, gelato_image_spec *spec, gelato_message message)
{
    (void) message;
    return index == 0 ? describe ((Image *) self, spec) : GELATO_FAILED;
}

static int read_native_scanline (void *self, int y, int z, void *data, gelato_message message)
{
    Image *image = (Image *) self;
    size_t row = (size_t) image->width * image->n;
    (void) z;
    if (y < 0 || y >= image->height)
        return fail (message, "there is no such row");
    memcpy (data, image->pixels + row * y, row * sizeof(float));
    return GELATO_OK;
}

static int read_native_tile (void *self, int x, int y, int z, void *data, gelato_message message)
{
    (void) self, (void) x, (void) y, (void) z, (void) data;
    return fail (message, "no tiles");
}

static int input_close (void *self, gelato_message message)
{
    Image *image = (Image *) self;
    (void) message;
    if (image->file)
        fclose (image->file);
    image->file = NULL;
    return GELATO_OK;
}

static const gelato_image_output_calls output = {
    GELATO_C_ABI, create, supports, output_open, write_scanline, write_tile, write_rectangle, output_close, destroy
};

static const gelato_image_input_calls input = {
    GELATO_C_ABI, create, input_open, seek_subimage, read_native_scanline, read_native_tile, NULL, NULL, NULL, input_close,
    destroy
};

const gelato_image_output_calls *plain_output_imageio_c (void) { return &output; }
const gelato_image_input_calls *plain_input_imageio_c (void) { return &input; }
