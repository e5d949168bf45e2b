// Stores messages and images, so that a program of the tests can check them. There are no locks here, so that all
// synchronisation is that of the library.
#ifndef KEPT_H
#define KEPT_H

#include <string>

#include "check.h"
#include "gelatoapi.h"
#include "imageio.h"

// Receives messages, one at a time, from any thread.
class Kept : public Gelato::ErrorHandler {
public:
    std::string all;
    int count, last;
    Kept () : count (0), last (0) {}
    void operator() (Gelato::ErrCode code, const char *msg) {
        ++count;
        last = code;
        all += std::string (msg) + "\n";
    }
    bool has (const char *text) const { return all.find (text) != std::string::npos; }
};

// Receives rows of "rgb", in order, from one thread at a time.
class Pixels : public Gelato::ImageOutput {
public:
    int rows, width, closed;
    double sum;
    Pixels () : rows (0), width (0), closed (0), sum (0) {}
    bool open (const char *, const Gelato::ImageIOFormatSpec &spec, int nparams, const Gelato::ImageIOParameter *param, bool) {
        int index;
        CHECK (Gelato::IOParamFindValue ("quantize", Gelato::PT_INT, 4, index, nparams, param));
        CHECK (Gelato::IOParamFindValue ("worldtocamera", Gelato::PT_FLOAT, 16, index, nparams, param));
        CHECK (spec.nchannels == 3 && spec.channelnames.size () == 3);
        CHECK (spec.channelnames[0][0] == 'R' && spec.channelnames[2][0] == 'B');
        width = spec.width;
        rows = 0;
        sum = 0;
        return true;
    }
    bool write_scanline (int y, int, const float *data, int xstride) {
        CHECK (y == rows++);
        for (int x = 0; x < width; ++x)
            sum += data[x * xstride];
        return true;
    }
    bool close () { ++closed; return true; }
};

// Declares an output of the camera whose pixels go to an image of the program.
static inline void output (GelatoAPI *r, const char *name, Gelato::ImageOutput *image)
{
    char address[30];
    snprintf (address, sizeof(address), "%p", (void *) image);
    r->Output (name, address, "rgb", "camera");
}

#endif
