// Tests a renderer in another process: images, messages, attributes, an early end, and the death of the process.
#include <dirent.h>
#include <signal.h>
#include <time.h>
#include <unistd.h>

#include "kept.h"

using namespace Gelato;

// Returns the number of running child processes, and stores the id of one of them.
static int children (int *first)
{
    int n = 0;
    DIR *all = opendir ("/proc");
    while (struct dirent *entry = all ? readdir (all) : NULL) {
        char name[300], state;
        int pid, parent;
        snprintf (name, sizeof(name), "/proc/%s/stat", entry->d_name);
        FILE *file = atoi (entry->d_name) > 0 ? fopen (name, "r") : NULL;
        if (file && fscanf (file, "%d (%*[^)]) %c %d", &pid, &state, &parent) == 3 && parent == getpid () && state != 'Z') {
            ++n;
            *first = pid;
        }
        if (file)
            fclose (file);
    }
    if (all)
        closedir (all);
    return n;
}

static void scene (GelatoAPI *r, Pixels *image, int width, float quality)
{
    int res[2] = { width, width * 3 / 4 };
    float spatialquality[2] = { quality, quality };
    r->Attribute ("resolution", res);
    r->Attribute ("spatialquality", spatialquality);
    output (r, "image", image);
    r->World ();
    r->Translate (0, 0, 3);
    r->Shader ("surface", "defaultsurface");
    r->Sphere (1);
}

int main ()
{
    Kept kept;
    ErrorManager *a = ErrorManager::Create (&kept);
    GelatoAPI *r = GelatoAPI::CreateRenderer ("remote", a);
    CHECK (r && kept.all.empty ());
    int child = 0;
    CHECK (children (&child) == 1);

    float done = -1, fov = 0;
    int said_success = -1;
    int res[2] = { 0, 0 };
    char *text = NULL;
    Pixels image;
    r->Attribute ("nosuchattribute", 1);
    r->Attribute ("fov", 37);
    CHECK (r->GetAttribute ("fov", fov) && fov == 37 && ! r->GetAttribute ("quux", fov));
    CHECK (kept.has ("nosuchattribute") && kept.last == ERR_WARNING);
    r->Attribute ("string projection", "orthographic");
    CHECK (r->GetAttribute ("projection", text) && std::string (text) == "orthographic");
    scene (r, &image, 32, 4);
    CHECK (r->GetAttribute ("resolution", res) && res[0] == 32 && res[1] == 24);
    r->Render ();
    r->Command ("wait");
    CHECK (r->GetAttribute ("render:progress", done) && done == 1);
    CHECK (image.rows == 24 && image.closed == 1 && image.sum > 1);
    CHECK (kept.count == 1);
    delete r;
    CHECK (children (&child) == 0);

    // During a long frame only queries and commands are accepted. The frame can be ended.
    Pixels large;
    r = GelatoAPI::CreateRenderer ("remote", a);
    scene (r, &large, 1600, 12);
    r->Render ();
    CHECK (r->GetAttribute ("render:progress", done) && done >= 0 && done < 1);
    r->Sphere (2);
    CHECK (kept.has ("Sphere is ignored while a frame is rendered"));
    // The program waits for a limited time, and sets the order of the buckets.
    const int said = kept.count;
    int center[2] = { 10, 1100 }, rectangle[4] = { 0, 0, 100, 100 };
    r->Parameter ("int[2] center", center);
    r->Command ("bucketpriority");
    r->Parameter ("int[4] rectangle", rectangle);
    r->Command ("bucketpriority");
    time_t begin = time (NULL);
    r->Parameter ("float time", 0.1f);
    r->Command ("wait");
    CHECK (time (NULL) - begin < 5 && r->GetAttribute ("render:progress", done) && done < 1);
    CHECK (kept.count == said);
    r->Command ("bucketpriority");
    CHECK (kept.has ("needs the parameter"));
    r->Command ("return");
    r->Command ("wait");
    CHECK (kept.has ("stopped") || kept.has ("ended"));
    // A frame that was ended early counts as done.
    CHECK (r->GetAttribute ("render:progress", done) && done == 1);
    CHECK (r->GetAttribute ("render:success", said_success) && said_success == 0);
    delete r;
    CHECK (children (&child) == 0);

    // A process that is killed causes one message, and the program continues.
    kept.all.clear ();
    r = GelatoAPI::CreateRenderer ("remote", a);
    r->Translate (0, 0, 1);
    CHECK (r->GetAttribute ("fov", fov) && children (&child) == 1);
    kept.count = 0;
    kill (child, SIGKILL);
    CHECK (! r->GetAttribute ("fov", fov));
    for (int i = 0; i < 20000; ++i)
        r->Translate (0, 0, 1);
    r->World ();
    r->Sphere (1);
    r->Render ();
    r->Command ("wait");
    CHECK (! r->GetAttribute ("fov", fov));
    delete r;
    CHECK (kept.count == 1 && kept.last == ERR_ERROR && kept.has ("process has ended"));

    // A process that is stopped counts as dead after the longest allowed silence.
    setenv ("GELATO_REMOTE_TIMEOUT", "2", 1);
    r = GelatoAPI::CreateRenderer ("remote", a);
    CHECK (r->GetAttribute ("fov", fov) && children (&child) == 1);
    kept.all.clear ();
    kept.count = 0;
    kill (child, SIGSTOP);
    // These calls exceed the buffer of a socket.
    for (int i = 0; i < 200000; ++i)
        r->Translate (0, 0, 1);
    CHECK (! r->GetAttribute ("fov", fov));
    r->World ();
    r->Render ();
    r->Command ("wait");
    delete r;
    CHECK (kept.count == 1 && kept.last == ERR_ERROR && kept.has ("silent for 2 s"));
    CHECK (children (&child) == 0);
    delete a;
    return 0;
}
