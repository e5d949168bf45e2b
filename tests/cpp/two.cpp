// Tests two renderers with alternating calls and their own handlers, then one in another process.
#include <string.h>

#include "kept.h"

using namespace Gelato;

// Receives rectangles in any order, and each pixel once.
class Live : public ImageOutput {
public:
    int pieces, pixels, closed, seen[24][32];
    float sum;
    Live () : pieces (0), pixels (0), closed (0), sum (0) { memset (seen, 0, sizeof(seen)); }
    bool supports_random_access () const { return true; }
    bool supports_rectangles () const { return true; }
    bool open (const char *, const ImageIOFormatSpec &, int, const ImageIOParameter *, bool) { return true; }
    bool write_rectangle (int xmin, int xmax, int ymin, int ymax, int zmin, int zmax, const float *data, int xstride,
                          int ystride, int) {
        CHECK (xmin >= 0 && xmax < 32 && ymin >= 0 && ymax < 24 && zmin == 0 && zmax == 0);
        ++pieces;
        for (int y = ymin; y <= ymax; ++y)
            for (int x = xmin; x <= xmax; ++x) {
                CHECK (++seen[y][x] == 1);
                ++pixels;
                sum += data[(y - ymin) * ystride + (x - xmin) * xstride];
            }
        return true;
    }
    bool close () { ++closed; return true; }
};

class Ball : public GelatoAPI::Generator {
public:
    Ball (int *runs, int *lost) : runs (runs), lost (lost) {}
    ~Ball () { ++*lost; }
    void run (GelatoAPI *r, const char *) {
        ++*runs;
        r->Translate (0, 0, 3);
        r->Shader ("surface", "defaultsurface");
        r->Sphere (1);
    }
private:
    int *runs, *lost;
};

static void output (GelatoAPI *r, ImageOutput *image, int width)
{
    int res[2] = { width, 24 };
    r->Attribute ("resolution", res);
    output (r, "image", image);
}

int main ()
{
    Kept first, second;
    ErrorManager *a = ErrorManager::Create (&first), *b = ErrorManager::Create (&second, VERBOSITY_QUIET);
    GelatoAPI *r = GelatoAPI::CreateRenderer (NULL, a), *s = GelatoAPI::CreateRenderer ("", b);
    CHECK (r && s && &r->Err () == a && a->Handler () == &first && b->Verbosity () == VERBOSITY_QUIET);
    Pixels here, there;
    output (r, &here, 32);
    output (s, &there, 16);
    int res[2] = { 0, 0 };
    float fov = 0, color[3];
    char *text = NULL;
    CHECK (r->GetAttribute ("resolution", res) && res[0] == 32 && s->GetAttribute ("int[2] resolution", res) && res[0] == 16);
    CHECK (r->GetAttribute ("fov", fov) && fov == 90 && ! r->GetAttribute ("string fov", text) && ! r->GetAttribute ("quux", fov));
    r->Attribute ("string projection", "orthographic");
    CHECK (r->GetAttribute ("projection", text) && std::string (text) == "orthographic");
    CHECK (s->GetAttribute ("projection", text) && std::string (text) == "perspective");
    r->World ();
    s->World ();
    float red[3] = { 1, 0, 0 };
    r->Attribute ("C", red);
    CHECK (r->GetAttribute ("C", color) && color[1] == 0 && s->GetAttribute ("C", color) && color[1] == 1);
    r->Translate (0, 0, 3);
    s->Translate (0, 0, 3);
    r->Shader ("surface", "defaultsurface");
    s->Patch ("nonsense", 2, 2);
    r->Sphere (1);
    s->PopAttributes ();
    s->Shader ("surface", "defaultsurface");
    s->Sphere (0.5f);
    r->Err ().Message ("%s %d", "said", 1);
    s->Render ();
    r->Render ();
    CHECK (here.rows == 24 && there.rows == 24 && here.sum > 2 * there.sum && there.sum > 0);
    CHECK (first.all == "said 1\n" && first.last == ERR_MESSAGE);
    CHECK (second.last == ERR_ERROR && second.all.find ("nonsense") != std::string::npos);
    char *summary = b->Summary ();
    CHECK (summary && std::string (summary).find ("error") != std::string::npos);
    free (summary);
    float done = 0;
    CHECK (r->GetAttribute ("render:progress", done) && done == 1);
    delete r;
    delete s;
    a->Handler (&second);
    a->Error ("to the other");
    CHECK (second.all.find ("to the other") != std::string::npos);
    // Each kind of message has its code. The verbosity determines which messages are passed on.
    a->Verbosity (VERBOSITY_INFO);
    a->Info ("%d", 1);
    CHECK (second.last == ERR_INFO);
    a->Warning ("%d", 2);
    CHECK (second.last == ERR_WARNING);
    a->Severe ("%d", 3);
    CHECK (second.last == ERR_SEVERE);
    a->Verbosity (VERBOSITY_QUIET);
    int count = second.count;
    a->Info ("%d", 4);
    a->Warning ("%d", 5);
    CHECK (second.count == count);
    a->Error ("%d", 6);
    CHECK (second.count == count + 1 && second.last == ERR_ERROR);
    a->Verbosity (VERBOSITY_NORMAL);
    delete b;

    // A generator of the program is deferred until the camera sees its bound. Another one is never seen.
    Pixels late;
    Live live;
    r = GelatoAPI::CreateRenderer (NULL, a);
    output (r, &late, 32);
    int bucket[2] = { 16, 16 };
    r->Attribute ("int[2] limits:bucketsize", bucket);
    output (r, "live", &live);
    r->World ();
    const float seen[6] = { -1, 1, -1, 1, 2, 4 }, unseen[6] = { -1, 1, -1, 1, -4, -2 };
    int runs = 0, lost = 0;
    r->Input (new Ball (&runs, &lost), seen);
    r->Input (new Ball (&runs, &lost), unseen);
    CHECK (runs == 0);
    r->Render ();
    CHECK (runs == 1 && late.rows == 24 && late.sum > 0);
    CHECK (live.pieces == 4 && live.pixels == 32 * 24 && live.closed == 1 && live.sum > 0.99f * late.sum
           && live.sum < 1.01f * late.sum);
    delete r;
    CHECK (lost == 2);

    // The program continues while this renderer works. Until it is done, only queries and commands are accepted.
    Pixels far;
    first.all.clear ();
    a->Handler (&first);
    r = GelatoAPI::CreateRenderer ("remote", a);
    output (r, &far, 32);
    r->World ();
    r->Translate (0, 0, 3);
    r->Sphere (1);
    r->Render ();
    CHECK (r->GetAttribute ("render:progress", done) && done >= 0 && done <= 1);
    r->Command ("wait");
    CHECK (r->GetAttribute ("render:progress", done) && done == 1);
    CHECK (far.rows == 24);
    delete r;
    delete a;
    return 0;
}
