/* Calls every function of granita_texture.h on the texture brick.tx, also with arguments that are not valid. */

#include <math.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "granita_texture.h"

#define CHECK(what) \
    do { \
        if (! (what)) { \
            fprintf (stderr, "line %d: %s is false (last failure: %s)\n", __LINE__, #what, granita_texture_error ()); \
            exit (1); \
        } \
    } while (0)

#define COUNT 5000

static granita_texture_system *system_;
static granita_texture_handle brick;
static float s[COUNT], t[COUNT], expected[COUNT];

static granita_texture_points points_of (float *result)
{
    granita_texture_points points;
    memset (&points, 0, sizeof (points));
    points.columns = COUNT;
    points.rows = 1;
    points.result = result;
    points.step = sizeof (float);
    points.channels = 1;
    return points;
}

static granita_texture_lookup2d lookup_of (void)
{
    granita_texture_lookup2d lookup;
    memset (&lookup, 0, sizeof (lookup));
    lookup.s.data = s;
    lookup.t.data = t;
    lookup.s.step = lookup.t.step = sizeof (float);
    return lookup;
}

static void *look (void *unused)
{
    float *result = malloc (sizeof (expected));
    granita_texture_points points = points_of (result);
    granita_texture_lookup2d lookup = lookup_of ();
    int i;
    (void) unused;
    for (i = 0; i < 3; ++i) {
        memset (result, 0, sizeof (expected));
        CHECK (granita_texture_lookup_2d (system_, brick, &points, &lookup) == GRANITA_TEXTURE_OK);
        CHECK (memcmp (result, expected, sizeof (expected)) == 0);
    }
    /* The text of a failure is that of the own thread. */
    CHECK (strcmp (granita_texture_error (), "") == 0);
    free (result);
    return NULL;
}

static int has_error (const char *part)
{
    return strstr (granita_texture_error (), part) != NULL;
}

static void misuse (void)
{
    float result[4] = { 1, 1, 1, 1 };
    const float one = 0.5f, fill = 7;
    granita_texture_points points = points_of (result);
    granita_texture_lookup2d lookup = lookup_of ();
    granita_texture_lookup3d lookup3d;
    granita_texture_environment environment;
    granita_texture_shadow shadow;
    granita_texture_settings settings = { GRANITA_TEXTURE_ABI };
    granita_texture_info info;
    uint64_t count;

    memset (&lookup3d, 0, sizeof (lookup3d));
    memset (&environment, 0, sizeof (environment));
    memset (&shadow, 0, sizeof (shadow));
    settings.abi = 99;
    CHECK (granita_texture_create (&settings) == NULL && has_error ("of version 99"));
    settings.abi = GRANITA_TEXTURE_ABI;
    settings.threads = -2;
    CHECK (granita_texture_create (&settings) == NULL && has_error ("-2 threads"));
    settings.threads = 0;
    settings.files = -1;
    CHECK (granita_texture_create (&settings) == NULL && has_error ("-1 open files"));
    CHECK (granita_texture_open (NULL, "brick.tx") == 0 && has_error ("no texture system (NULL)"));
    CHECK (granita_texture_open (system_, NULL) == 0 && has_error ("no texture is named"));
    CHECK (granita_texture_open (system_, "none.tx") == 0 && has_error ("texture \"none.tx\" not found"));
    CHECK (granita_texture_get_info (system_, 0, &info) == GRANITA_TEXTURE_MISUSE);
    CHECK (granita_texture_get_info (system_, 77, &info) == GRANITA_TEXTURE_MISUSE && has_error ("77 is not"));
    CHECK (granita_texture_get_info (system_, brick, NULL) == GRANITA_TEXTURE_MISUSE);
    CHECK (granita_texture_get_metadatum (system_, brick, "none", 0, NULL) == GRANITA_TEXTURE_ABSENT);
    CHECK (granita_texture_get_metadatum (system_, brick, NULL, 1000, NULL) == GRANITA_TEXTURE_ABSENT);
    CHECK (granita_texture_info_json (system_, 77) == NULL);
    CHECK (granita_texture_get_statistic (system_, "none", &count) == GRANITA_TEXTURE_ABSENT && has_error ("lookups,"));
    CHECK (granita_texture_get_statistic (system_, NULL, &count) == GRANITA_TEXTURE_ABSENT);
    CHECK (granita_texture_set_threads (system_, -3) == GRANITA_TEXTURE_MISUSE);
    CHECK (granita_texture_set_threads (NULL, 1) == GRANITA_TEXTURE_MISUSE);
    CHECK (granita_texture_messages (NULL) == NULL && granita_texture_statistics_text (NULL) == NULL);
    CHECK (granita_texture_invalidate (NULL, NULL) == GRANITA_TEXTURE_MISUSE);
    granita_texture_destroy (NULL);
    granita_texture_free (NULL);

    points.columns = 1;
    CHECK (granita_texture_lookup_2d (system_, brick, NULL, &lookup) == GRANITA_TEXTURE_MISUSE);
    CHECK (granita_texture_lookup_2d (system_, brick, &points, NULL) == GRANITA_TEXTURE_MISUSE);
    lookup.t.data = NULL;
    CHECK (granita_texture_lookup_2d (system_, brick, &points, &lookup) == GRANITA_TEXTURE_MISUSE && has_error ("t is"));
    lookup.t.data = &one;
    lookup.filter = 3;
    CHECK (granita_texture_lookup_2d (system_, brick, &points, &lookup) == GRANITA_TEXTURE_MISUSE);
    lookup.filter = 0;
    lookup.swrap = "round";
    CHECK (granita_texture_lookup_2d (system_, brick, &points, &lookup) == GRANITA_TEXTURE_MISUSE && has_error ("round"));
    lookup.swrap = "default";
    points.channels = 0;
    CHECK (granita_texture_lookup_2d (system_, brick, &points, &lookup) == GRANITA_TEXTURE_MISUSE);
    points.channels = 1;
    points.first_channel = -1;
    CHECK (granita_texture_lookup_2d (system_, brick, &points, &lookup) == GRANITA_TEXTURE_MISUSE);
    points.first_channel = 0;
    points.result = NULL;
    CHECK (granita_texture_lookup_2d (system_, brick, &points, &lookup) == GRANITA_TEXTURE_MISUSE);
    points.columns = (size_t) -1;
    points.rows = 3;
    CHECK (granita_texture_lookup_2d (system_, brick, &points, &lookup) == GRANITA_TEXTURE_MISUSE && has_error ("too many"));
    points.columns = 0;
    points.rows = 1;
    CHECK (granita_texture_lookup_2d (system_, brick, &points, &lookup) == GRANITA_TEXTURE_OK);
    points.columns = 1;
    points.result = result;
    CHECK (granita_texture_lookup_3d (system_, brick, &points, &lookup3d) == GRANITA_TEXTURE_MISUSE);
    CHECK (granita_texture_lookup_environment (system_, brick, &points, &environment) == GRANITA_TEXTURE_MISUSE);
    CHECK (granita_texture_lookup_shadow (system_, brick, &points, &shadow) == GRANITA_TEXTURE_MISUSE);
    shadow.p.data = result;
    shadow.p.component_step = sizeof (float);
    shadow.samples = -1;
    CHECK (granita_texture_lookup_shadow (system_, brick, &points, &shadow) == GRANITA_TEXTURE_MISUSE);
    shadow.samples = 0;
    CHECK (granita_texture_lookup_shadow (system_, brick, &points, &shadow) == GRANITA_TEXTURE_UNUSABLE);
    CHECK (granita_texture_texels (system_, brick, 99, 0, 0, &points) == GRANITA_TEXTURE_MISUSE);
    CHECK (granita_texture_texels (system_, brick, 0, 512, 0, &points) == GRANITA_TEXTURE_MISUSE);

    /* The points of a texture that is lost get `fill`. */
    {
        granita_texture_handle lost = granita_texture_open (system_, "lost.tx");
        CHECK (lost != 0);
        CHECK (remove ("lost.tx") == 0);
        CHECK (granita_texture_invalidate (system_, "lost.tx") == GRANITA_TEXTURE_OK);
        points.fill.data = &fill;
        CHECK (granita_texture_lookup_2d (system_, lost, &points, &lookup) == GRANITA_TEXTURE_UNUSABLE);
        CHECK (result[0] == 7 && result[1] == 1);
    }
}

static void copy (const char *from, const char *to)
{
    FILE *in = fopen (from, "rb"), *out = fopen (to, "wb");
    int c;
    CHECK (in && out);
    while ((c = getc (in)) != EOF)
        putc (c, out);
    fclose (in);
    CHECK (fclose (out) == 0);
}

int main (void)
{
    granita_texture_settings settings = { GRANITA_TEXTURE_ABI };
    granita_texture_info info;
    granita_texture_metadatum datum;
    granita_texture_points points;
    granita_texture_lookup2d lookup;
    pthread_t threads[4];
    uint64_t count = 0;
    float texels[4][3][2];
    char *text;
    int i;

    CHECK (granita_texture_abi () == GRANITA_TEXTURE_ABI);
    CHECK (strchr (granita_texture_version (), '.') != NULL);
    CHECK (strcmp (granita_texture_error (), "") == 0);
    copy ("brick.tx", "lost.tx");
    settings.memory = 1 << 20;
    settings.search_path = "nowhere:.";
    system_ = granita_texture_create (&settings);
    CHECK (system_ != NULL);
    brick = granita_texture_open (system_, "brick.tx");
    CHECK (brick != 0 && granita_texture_open (system_, "brick.tx") == brick);

    CHECK (granita_texture_get_info (system_, brick, &info) == GRANITA_TEXTURE_OK);
    CHECK (info.width == 512 && info.height == 512 && info.face_width == 512 && info.tile_width == 64);
    CHECK (info.channels == 1 && info.levels == 10 && info.squares == 0);
    CHECK (info.level_sizes[2] == 256 && info.level_sizes[19] == 1);
    CHECK (! strcmp (info.kind, "Plain Texture") && ! strcmp (info.type, "texture") && ! strcmp (info.format, "uint8"));
    CHECK (! strcmp (info.swrap, "periodic") && ! strcmp (info.twrap, "periodic") && ! strcmp (info.channel_names[0], "Y"));
    CHECK (info.average[0] > 0 && info.average[0] < 1 && strstr (info.path, "brick.tx"));
    CHECK (granita_texture_get_metadatum (system_, brick, "wrapmodes", 0, &datum) == GRANITA_TEXTURE_OK);
    CHECK (! strcmp (datum.type, "string") && datum.count == 1 && ! strcmp (datum.strings[0], "periodic"));
    CHECK (datum.floats == NULL && datum.ints == NULL);
    CHECK (granita_texture_get_metadatum (system_, brick, NULL, 0, &datum) == GRANITA_TEXTURE_OK && datum.name);
    text = granita_texture_info_json (system_, brick);
    CHECK (text && strstr (text, "\"width\":512"));
    granita_texture_free (text);

    for (i = 0; i < COUNT; ++i) {
        s[i] = (float) (i % 71) / 70;
        t[i] = (float) (i % 53) / 52;
    }
    points = points_of (expected);
    lookup = lookup_of ();
    CHECK (granita_texture_lookup_2d (system_, brick, &points, &lookup) == GRANITA_TEXTURE_OK);
    for (i = 0; i < COUNT; ++i)
        CHECK (expected[i] >= 0 && expected[i] <= 1);
    CHECK (granita_texture_set_threads (system_, 2) == GRANITA_TEXTURE_OK);
    for (i = 0; i < 4; ++i)
        CHECK (pthread_create (&threads[i], NULL, look, NULL) == 0);
    for (i = 0; i < 4; ++i)
        CHECK (pthread_join (threads[i], NULL) == 0);

    /* Backward, and each point twice. */
    {
        float result[COUNT][2];
        points.result = &result[0][0];
        points.step = sizeof (result[0]);
        points.rows = 2;
        points.row_step = sizeof (float);
        lookup.s.data = s + COUNT - 1;
        lookup.t.data = t + COUNT - 1;
        lookup.s.step = lookup.t.step = -(ptrdiff_t) sizeof (float);
        CHECK (granita_texture_lookup_2d (system_, brick, &points, &lookup) == GRANITA_TEXTURE_OK);
        for (i = 0; i < COUNT; ++i)
            CHECK (result[i][0] == expected[COUNT - 1 - i] && result[i][1] == result[i][0]);
    }

    /* Four rows of three texels, and a channel that the file lacks. */
    points = points_of (&texels[0][0][0]);
    points.columns = 3;
    points.rows = 4;
    points.channels = 2;
    points.step = sizeof (texels[0][0]);
    points.row_step = sizeof (texels[0]);
    points.channel_step = sizeof (float);
    CHECK (granita_texture_texels (system_, brick, 1, 253, 7, &points) == GRANITA_TEXTURE_OK);
    for (i = 0; i < 12; ++i)
        CHECK (fabs (255 * texels[i / 3][i % 3][0] - floor (255 * texels[i / 3][i % 3][0] + 0.5)) < 1e-4 &&
               texels[i / 3][i % 3][1] == 0);

    misuse ();
    CHECK (granita_texture_get_statistic (system_, "lookups", &count) == GRANITA_TEXTURE_OK && count > 13 * COUNT);
    text = granita_texture_statistics_text (system_);
    CHECK (text && strstr (text, "lookups: "));
    granita_texture_free (text);
    text = granita_texture_statistics_json (system_);
    CHECK (text && text[0] == '{' && strstr (text, "\"peak_bytes\":"));
    granita_texture_free (text);
    CHECK (granita_texture_invalidate (system_, NULL) == GRANITA_TEXTURE_OK);
    /* What was returned before is still there. */
    CHECK (strstr (info.path, "brick.tx"));
    CHECK (granita_texture_get_info (system_, brick, &info) == GRANITA_TEXTURE_OK);
    text = granita_texture_messages (system_);
    CHECK (text == NULL);
    granita_texture_destroy (system_);
    return 0;
}
