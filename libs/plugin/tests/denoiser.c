/* A library with the functions of Open Image Denoise that are used, for tests. With NEW defined it has the names of
   version 2. Its output is a half of the colour and a quarter each of albedo and normal, or a half each where these are
   said to be clean. Albedo or normal alone become greater by 1. A pixel of the colour -1 is an error. */

#include <stdbool.h>
#include <stddef.h>
#include <stdlib.h>
#include <string.h>

#ifdef NEW
#define SET_INT oidnSetDeviceInt
#define SET_BOOL oidnSetDeviceBool
#define GET_INT oidnGetDeviceInt
#define SET_FILTER_BOOL oidnSetFilterBool
#ifndef VERSION
#define VERSION 20501
#endif
#else
#define SET_INT oidnSetDevice1i
#define SET_BOOL oidnSetDevice1b
#define GET_INT oidnGetDevice1i
#define SET_FILTER_BOOL oidnSetFilter1b
#ifndef VERSION
#define VERSION 10403
#endif
#endif

typedef struct { const char *error; int threads; bool committed; } Device;
typedef struct { Device *device; float *planes[4]; size_t pixels; bool hdr, clean, committed; } Filter;

static const char *const NAMES[4] = {"color", "albedo", "normal", "output"};

Device *oidnNewDevice (int type)
{
    return type == 1 ? calloc (1, sizeof (Device)) : NULL;
}

void SET_INT (Device *device, const char *name, int value)
{
    if (strcmp (name, "numThreads") == 0) device->threads = value;
}

void SET_BOOL (Device *device, const char *name, bool value)
{
    if (strcmp (name, "setAffinity") == 0 && value) device->error = "threads must not be bound to processors";
}

int GET_INT (Device *device, const char *name)
{
    (void) device;
    return strcmp (name, "version") == 0 ? VERSION : 0;
}

void oidnCommitDevice (Device *device)
{
    if (device->threads < 1) device->error = "no number of threads";
    device->committed = true;
}

int oidnGetDeviceError (Device *device, const char **text)
{
    *text = device->error;
    device->error = NULL;
    return *text != NULL;
}

void oidnReleaseDevice (Device *device)
{
    free (device);
}

Filter *oidnNewFilter (Device *device, const char *type)
{
    if (!device->committed || strcmp (type, "RT") != 0) return NULL;
    Filter *filter = calloc (1, sizeof (Filter));
    filter->device = device;
    return filter;
}

void oidnSetSharedFilterImage (Filter *filter, const char *name, void *data, int format, size_t width, size_t height,
                               size_t offset, size_t pixel_stride, size_t row_stride)
{
    if (format != 3 || offset || pixel_stride || row_stride) filter->device->error = "a format without gaps is expected";
    for (int k = 0; k < 4; k++)
        if (strcmp (name, NAMES[k]) == 0) filter->planes[k] = data;
    filter->pixels = width * height;
}

void SET_FILTER_BOOL (Filter *filter, const char *name, bool value)
{
    if (strcmp (name, "hdr") == 0) filter->hdr = value;
    if (strcmp (name, "cleanAux") == 0) filter->clean = value;
}

void oidnCommitFilter (Filter *filter)
{
    filter->committed = !filter->planes[0] || filter->hdr;
}

void oidnExecuteFilter (Filter *filter)
{
    float *const *planes = filter->planes;
    const float *alone = planes[0] || (planes[1] && planes[2]) ? NULL : planes[1] ? planes[1] : planes[2];
    if (!filter->committed || !planes[3] || !(alone || (planes[0] && planes[1] && planes[2]))) {
        filter->device->error = "the filter is not complete";
        return;
    }
    for (size_t i = 0; alone && i < 3 * filter->pixels; i++) planes[3][i] = alone[i] + 1;
    if (alone) return;
    for (size_t i = 0; i < 3 * filter->pixels; i++) {
        if (planes[0][i] == -1) filter->device->error = "a colour is -1";
        planes[3][i] = 0.5f * planes[0][i] + (filter->clean ? 0.5f : 0.25f) * (planes[1][i] + planes[2][i]);
    }
}

void oidnReleaseFilter (Filter *filter)
{
    free (filter);
}
