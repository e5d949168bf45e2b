// A program that receives the pixels of a render and prints them as characters.
#include <stdio.h>

#include "gelatoapi.h"
#include "imageio.h"

class Letters : public Gelato::ImageOutput {
public:
    bool open (const char *, const Gelato::ImageIOFormatSpec &spec, int, const Gelato::ImageIOParameter *, bool) {
        width = spec.width;
        return true;
    }
    // Rows come in order from the top. They are linear light. The receiver applies gain and quantization.
    bool write_scanline (int, int, const float *data, int xstride) {
        for (int x = 0; x < width; ++x)
            putchar (" .:-=+*#%@"[quantize (exposure (data[x * xstride], 1, 1 / 2.2f), 0, 9, 0, 9, 0)]);
        putchar ('\n');
        return true;
    }
    bool close () { return true; }
private:
    int width;
};

int main ()
{
    GelatoAPI *r = GelatoAPI::CreateRenderer ();
    if (r == NULL)
        return 1;
    Letters image;
    char address[32];
    snprintf (address, sizeof(address), "%p", (void *) &image);
    int resolution[2] = { 64, 28 };
    r->Attribute ("resolution", resolution);
    r->Attribute ("pixelaspect", 0.5f);
    r->Output ("letters", address, "rgb", "main");
    r->World ();
    const float from[3] = { -4, 4, -4 };
    r->Parameter ("point from", from);
    r->Parameter ("float intensity", 90.0f);
    r->Light ("key", "pointlight");
    r->Shader ("surface", "plastic");
    r->Translate (0, 0, 3);
    r->Sphere (1.2f);
    r->Render ();
    delete r;
    return 0;
}
