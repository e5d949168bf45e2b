// Conversions by the library OpenColorIO, as a plugin (granita_color.h).
//
//     c++ -O2 -std=c++14 -shared -fPIC -I../include opencolorio.cpp -lOpenColorIO -o opencolorio.color.so

#include "granita_color.h"

#include <OpenColorIO/OpenColorIO.h>

#include <cstdio>
#include <exception>
#include <string>

namespace ocio = OCIO_NAMESPACE;

struct granita_color {
    ocio::ConstCPUProcessorRcPtr processor;
};

namespace {

ocio::ConstTransformRcPtr transform(int kind, const char *a, const char *b, const char *c, int inverse)
{
    if (kind == GRANITA_COLOR_VIEW) {
        ocio::DisplayViewTransformRcPtr view = ocio::DisplayViewTransform::Create();
        view->setSrc(a);
        view->setDisplay(b);
        view->setView(c);
        return view;
    }
    if (kind == GRANITA_COLOR_LOOKS) {
        ocio::LookTransformRcPtr looks = ocio::LookTransform::Create();
        looks->setSrc(a);
        looks->setDst(b);
        looks->setLooks(c);
        return looks;
    }
    if (kind == GRANITA_COLOR_FILE) {
        ocio::FileTransformRcPtr file = ocio::FileTransform::Create();
        file->setSrc(a);
        file->setInterpolation(ocio::INTERP_BEST);
        file->setDirection(inverse ? ocio::TRANSFORM_DIR_INVERSE : ocio::TRANSFORM_DIR_FORWARD);
        return file;
    }
    ocio::ColorSpaceTransformRcPtr spaces = ocio::ColorSpaceTransform::Create();
    spaces->setSrc(a);
    spaces->setDst(b);
    return spaces;
}

} // namespace

extern "C" {

int granita_color_version(void)
{
    return GRANITA_COLOR_VERSION;
}

const char *granita_color_library(void)
{
    static const std::string name = std::string("OpenColorIO ") + ocio::GetVersion();
    return name.c_str();
}

granita_color *granita_color_open(const char *config, int kind, const char *a, const char *b, const char *c, int inverse,
                                  char *error, size_t room)
{
    try {
        const ocio::ConstConfigRcPtr found = ocio::Config::CreateFromFile(config);
        const ocio::ConstProcessorRcPtr processor = found->getProcessor(transform(kind, a, b, c, inverse));
        return new granita_color{processor->getDefaultCPUProcessor()};
    } catch (const std::exception &failure) {
        if (room > 0) {
            std::snprintf(error, room, "%s", failure.what());
        }
    } catch (...) {
        if (room > 0) {
            std::snprintf(error, room, "an unknown error");
        }
    }
    return nullptr;
}

void granita_color_apply(const granita_color *conversion, float *rgb, size_t pixels)
{
    try {
        ocio::PackedImageDesc image(rgb, static_cast<long>(pixels), 1, 3);
        conversion->processor->apply(image);
    } catch (...) {
        // The sizes and the type of the image are always valid.
    }
}

void granita_color_close(granita_color *conversion)
{
    delete conversion;
}

} // extern "C"
