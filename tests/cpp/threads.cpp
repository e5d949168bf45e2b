// Renderers and threads, for a tool that watches for races (`cargo xtask races`): nothing here but what is said below takes a
// lock, so that whatever order there is comes from the library.
#include <atomic>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string>
#include <thread>

#include "gelatoapi.h"
#include "imageio.h"

using namespace Gelato;

#define CHECK(what) do { if (! (what)) { fprintf (stderr, "line %d: %s\n", __LINE__, #what); exit (1); } } while (0)

// Gets messages "one at a time, from whatever thread".
class Kept : public ErrorHandler {
public:
    std::string all;
    int count;
    Kept () : count (0) {}
    void operator() (ErrCode, const char *msg) {
        ++count;
        all += std::string (msg) + "\n";
    }
    bool has (const char *text) const { return all.find (text) != std::string::npos; }
};

// Gets rows "in order, from one thread at a time".
class Pixels : public ImageOutput {
public:
    int rows, width, closed;
    double sum;
    Pixels () : rows (0), width (0), closed (0), sum (0) {}
    bool open (const char *, const ImageIOFormatSpec &spec, int, const ImageIOParameter *, bool) {
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

static void output (GelatoAPI *r, Pixels *image)
{
    char address[30];
    int res[2] = { 48, 36 }, bucket[2] = { 8, 8 };
    snprintf (address, sizeof(address), "%p", (void *) image);
    r->Attribute ("resolution", res);
    r->Attribute ("int[2] limits:bucketsize", bucket);
    r->Attribute ("limits:threads", 4);
    r->Output ("image", address, "rgb", "camera");
}

// Shadows by rays, a shader that says things, a displaced and a moving thing, a shadeop that is not safe for threads.
static void things (GelatoAPI *r)
{
    float from[3] = { -4, 4, -4 };
    r->World ();
    r->Parameter ("float intensity", 40);
    r->Parameter ("point from", from);
    r->Parameter ("string shadowname", "shadows");
    r->Light ("key", "pointlight");
    r->Attribute ("string geometryset", "+shadows");
    r->Translate (0, 0, 5);
    r->PushTransform ();
    for (int i = 0; i < 6; ++i) {
        r->PushTransform ();
        r->Translate (1.5f * cosf (i), 1.5f * sinf (i), 0.2f * i);
        if (i % 2) {
            r->Motion (2, 0.0f, 1.0f);
            r->Translate (0, 0, 0);
            r->Translate (0.2f, 0, 0);
        }
        r->Parameter ("float Kd", 0.8f);
        r->Shader ("surface", "talks");
        r->Sphere (0.6f);
        r->PopTransform ();
    }
    r->PopTransform ();
    float p[12] = { -9, -9, 4, 9, -9, 4, -9, 9, 4, 9, 9, 4 };
    r->Shader ("surface", "matte");
    r->Parameter ("vertex point P", p);
    r->Patch ("linear", 2, 2);
}

// A renderer of its own in each thread.
static void alone (int rounds)
{
    Kept kept;
    ErrorManager *errors = ErrorManager::Create (&kept);
    for (int i = 0; i < rounds; ++i) {
        Pixels image;
        GelatoAPI *r = GelatoAPI::CreateRenderer (NULL, errors);
        CHECK (r);
        output (r, &image);
        things (r);
        r->Patch ("nonsense", 2, 2);
        r->Render ();
        CHECK (image.rows == 36 && image.closed == 1 && image.sum > 0);
        delete r;
        if (! kept.has ("shaded")) fprintf (stderr, "%s", kept.all.c_str ());
        CHECK (kept.has ("nonsense") && kept.has ("shaded"));
    }
    delete errors;
}

// A renderer whose manager another thread uses too.
static void shared (ErrorManager *errors, int number)
{
    Pixels image;
    GelatoAPI *r = GelatoAPI::CreateRenderer ("", errors);
    output (r, &image);
    things (r);
    r->Err ().Warning ("a warning of %d", number);
    r->Render ();
    CHECK (image.rows == 36);
    delete r;
}

// Asks while another renders.
static void asks (GelatoAPI *r, std::atomic<bool> *over)
{
    float done = 0, before = 0;
    while (! *over) {
        if (r->GetAttribute ("render:progress", done)) {
            CHECK (done >= 0 && done <= 1);
            before = done;
        }
        r->Err ().Verbosity ();
        std::this_thread::yield ();
    }
    (void) before;
}

int main ()
{
    // Two programs in one.
    {
        std::thread a (alone, 2), b (alone, 2);
        a.join ();
        b.join ();
        puts ("each alone");
    }
    // One manager for two.
    {
        Kept kept;
        ErrorManager *errors = ErrorManager::Create (&kept);
        std::thread a (shared, errors, 1), b (shared, errors, 2);
        a.join ();
        b.join ();
        CHECK (kept.has ("a warning of 1") && kept.has ("a warning of 2"));
        char *summary = errors->Summary ();
        free (summary);
        delete errors;
        puts ("one manager");
    }
    // A renderer that is asked, and one that is called by two at once: who comes second is refused.
    {
        Kept kept;
        ErrorManager *errors = ErrorManager::Create (&kept);
        Pixels image;
        GelatoAPI *r = GelatoAPI::CreateRenderer (NULL, errors);
        output (r, &image);
        things (r);
        std::atomic<bool> over (false);
        std::thread a (asks, r, &over);
        r->Render ();
        over = true;
        a.join ();
        CHECK (image.rows == 36);
        std::thread c ([&] { for (int i = 0; i < 2000; ++i) { r->Translate (0, 0, 1); r->Attribute ("float mine", i); } });
        for (int i = 0; i < 2000; ++i) {
            r->PushTransform ();
            r->PopTransform ();
        }
        c.join ();
        delete r;
        delete errors;
        puts ("asked");
    }
    // A frame that is ended by another thread.
    {
        Kept kept;
        ErrorManager *errors = ErrorManager::Create (&kept);
        Pixels image;
        GelatoAPI *r = GelatoAPI::CreateRenderer (NULL, errors);
        output (r, &image);
        things (r);
        std::atomic<bool> over (false);
        std::thread a ([&] {
            float done = 0;
            while (! over && ! (r->GetAttribute ("render:progress", done) && done > 0 && done < 1))
                std::this_thread::yield ();
            if (! over)
                r->Command ("return");
        });
        r->Render ();
        over = true;
        a.join ();
        delete r;
        delete errors;
        puts ("ended");
    }
    return 0;
}
