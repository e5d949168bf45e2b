// A plugin for conversions of colours that doubles values.

#include "granita_color.h"

#include <cstring>

struct granita_color {
    int kind;
};

extern "C" {

int granita_color_version(void) { return GRANITA_COLOR_VERSION; }

const char *granita_color_library(void) { return "doubling 1"; }

granita_color *granita_color_open(const char *config, int kind, const char *a, const char *b, const char *c, int,
                                  char *error, size_t room)
{
    if (kind != GRANITA_COLOR_VIEW || !std::strstr(config, "a.ocio") || std::strcmp(a, "ACES") != 0 ||
        std::strcmp(b, "screen") != 0 || std::strcmp(c, "film") != 0) {
        std::strncpy(error, "it was called with other words", room);
        return nullptr;
    }
    return new granita_color{kind};
}

void granita_color_apply(const granita_color *, float *rgb, size_t pixels)
{
    for (size_t i = 0; i < 3 * pixels; i++)
        rgb[i] *= 2;
}

void granita_color_close(granita_color *conversion) { delete conversion; }

} // extern "C"
