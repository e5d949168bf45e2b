// Uses renderers in several threads, under ThreadSanitizer (`cargo xtask races`). There are no locks here, so that all
// synchronisation is that of the library.
#include <atomic>
#include <math.h>
#include <thread>

#include "kept.h"

using namespace Gelato;

// Makes a scene with ray-traced shadows, moving spheres, and a shader that prints and calls a shadeop that is not
// thread-safe.
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

// Makes a frame of this scene with small buckets and several threads.
static void frame (GelatoAPI *r, Pixels *image)
{
    int res[2] = { 48, 36 }, bucket[2] = { 8, 8 };
    r->Attribute ("resolution", res);
    r->Attribute ("int[2] limits:bucketsize", bucket);
    r->Attribute ("limits:threads", 4);
    output (r, "image", image);
    things (r);
}

// A renderer with its own handler, and a frame that is ready to be rendered.
class Alone {
public:
    Kept kept;
    Pixels image;
    ErrorManager *errors;
    GelatoAPI *renderer;
    Alone () : errors (ErrorManager::Create (&kept)), renderer (GelatoAPI::CreateRenderer (NULL, errors)) {
        CHECK (renderer);
        frame (renderer, &image);
    }
    ~Alone () {
        delete renderer;
        delete errors;
    }
};

// Renders several frames with one manager. It runs in its own thread.
static void alone (int rounds)
{
    Kept kept;
    ErrorManager *errors = ErrorManager::Create (&kept);
    for (int i = 0; i < rounds; ++i) {
        Pixels image;
        GelatoAPI *r = GelatoAPI::CreateRenderer (NULL, errors);
        CHECK (r);
        frame (r, &image);
        r->Patch ("nonsense", 2, 2);
        r->Render ();
        CHECK (image.rows == 36 && image.closed == 1 && image.sum > 0);
        delete r;
        if (! kept.has ("shaded")) fprintf (stderr, "%s", kept.all.c_str ());
        CHECK (kept.has ("nonsense") && kept.has ("shaded"));
    }
    delete errors;
}

// Renders with a manager that another thread also uses.
static void shared (ErrorManager *errors, int number)
{
    Pixels image;
    GelatoAPI *r = GelatoAPI::CreateRenderer ("", errors);
    frame (r, &image);
    r->Err ().Warning ("a warning of %d", number);
    r->Render ();
    CHECK (image.rows == 36);
    delete r;
}

// Queries a renderer while another thread renders.
static void asks (GelatoAPI *r, std::atomic<bool> *over)
{
    float done = 0;
    while (! *over) {
        if (r->GetAttribute ("render:progress", done))
            CHECK (done >= 0 && done <= 1);
        r->Err ().Verbosity ();
        std::this_thread::yield ();
    }
}

int main ()
{
    // Two threads have their own managers and renderers.
    {
        std::thread a (alone, 2), b (alone, 2);
        a.join ();
        b.join ();
        puts ("each alone");
    }
    // Two renderers share one manager.
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
    // A renderer is queried while it renders. Then two threads call it at once, and the second call is refused.
    {
        Alone one;
        GelatoAPI *r = one.renderer;
        std::atomic<bool> over (false);
        std::thread a (asks, r, &over);
        r->Render ();
        over = true;
        a.join ();
        CHECK (one.image.rows == 36);
        std::thread c ([&] { for (int i = 0; i < 2000; ++i) { r->Translate (0, 0, 1); r->Attribute ("float mine", i); } });
        for (int i = 0; i < 2000; ++i) {
            r->PushTransform ();
            r->PopTransform ();
        }
        c.join ();
        puts ("asked");
    }
    // Another thread ends a frame.
    {
        Alone one;
        GelatoAPI *r = one.renderer;
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
        puts ("ended");
    }
    return 0;
}
