/* Measures Embree's own calls: embree_rays LIBRARY FOLDER.
   Reads from FOLDER mesh.v (three floats per vertex), mesh.f (three indices per triangle) and NAME.rays (origin, least
   distance, direction, largest distance). Prints lines "NAME closest|any SECONDS HITS" for single rays, and lines "NAME
   closest-packets|any-packets SECONDS HITS" for packets of 8 and 16 rays, without and with the hint that they are
   coherent. The seconds are those of one thread. */
#include <dlfcn.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

static double seconds(void) {
    struct timespec t;
    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

static void *whole(const char *folder, const char *name, size_t *size) {
    char path[4096];
    snprintf(path, sizeof path, "%s/%s", folder, name);
    FILE *file = fopen(path, "rb");
    if (!file) exit(2);
    fseek(file, 0, SEEK_END);
    *size = (size_t)ftell(file);
    rewind(file);
    /* Embree reads up to 16 bytes beyond the last vertex. */
    void *data = malloc(*size + 64);
    if (!data || fread(data, 1, *size, file) != *size) exit(2);
    fclose(file);
    return data;
}

/* RTCRayHit, with space for the fields that newer versions of the library have at its end. */
typedef struct {
    float origin[3], tnear, dir[3], time, tfar;
    unsigned mask, id, flags;
    float normal[3], u, v;
    unsigned primitive, geometry, instance[4];
} __attribute__((aligned(64))) RayHit;

static void fill(RayHit *ray, const float *from) {
    memcpy(ray->origin, from, 12);
    ray->tnear = from[3];
    memcpy(ray->dir, from + 4, 12);
    ray->tfar = from[7];
    ray->time = 0;
    ray->mask = ~0u;
    ray->id = ray->flags = 0;
    ray->geometry = ray->instance[0] = ray->instance[1] = ~0u;
}

/* RTCRayHit8 and RTCRayHit16, with space for the fields that newer versions of the library have at their ends, and
   functions that trace all rays in such packets. */
#define PACKETS(N)                                                                                                     \
    typedef struct {                                                                                                   \
        float origin[3][N], tnear[N], dir[3][N], time[N], tfar[N];                                                     \
        unsigned mask[N], id[N], flags[N];                                                                             \
        float normal[3][N], u[N], v[N];                                                                                \
        unsigned primitive[N], geometry[N], instance[4][N];                                                            \
    } __attribute__((aligned(64))) RayHit##N;                                                                          \
    static size_t trace##N(Packets call, void *scene, const float *rays, size_t n, void *arguments, int any) {         \
        size_t hits = 0;                                                                                               \
        for (size_t i = 0; i < n; i += N) {                                                                            \
            RayHit##N p;                                                                                               \
            int valid[N] __attribute__((aligned(64)));                                                                 \
            size_t own = n - i < N ? n - i : N;                                                                        \
            for (size_t k = 0; k < N; k++) {                                                                           \
                const float *from = rays + 8 * (i + (k < own ? k : 0));                                                \
                valid[k] = k < own ? -1 : 0;                                                                           \
                for (int a = 0; a < 3; a++) p.origin[a][k] = from[a], p.dir[a][k] = from[4 + a];                       \
                p.tnear[k] = from[3], p.tfar[k] = from[7], p.time[k] = 0;                                              \
                p.mask[k] = ~0u, p.id[k] = p.flags[k] = 0;                                                             \
                p.geometry[k] = p.instance[0][k] = p.instance[1][k] = ~0u;                                             \
            }                                                                                                          \
            call(valid, scene, &p, arguments);                                                                         \
            for (size_t k = 0; k < own; k++) hits += any ? p.tfar[k] < 0 : p.geometry[k] != ~0u;                       \
        }                                                                                                              \
        return hits;                                                                                                   \
    }

typedef void (*Packets)(const int *, void *, void *, void *);
PACKETS(8)
PACKETS(16)

/* RTCIntersectArguments and RTCOccludedArguments of Embree 4. */
typedef struct {
    unsigned flags, features;
    void *context, *filter, *intersect;
    char more[64];
} Arguments;

int main(int argc, char **argv) {
    if (argc < 3) return 2;
    void *library = dlopen(argv[1], RTLD_NOW | RTLD_GLOBAL);
    if (!library) return fprintf(stderr, "%s\n", dlerror()), 2;
#define CALL(result, name, ...) result (*name)(__VA_ARGS__) = (result (*)(__VA_ARGS__))dlsym(library, #name)
    CALL(void *, rtcNewDevice, const char *);
    CALL(void *, rtcNewScene, void *);
    CALL(void *, rtcNewGeometry, void *, int);
    CALL(void, rtcSetSharedGeometryBuffer, void *, int, unsigned, int, const void *, size_t, size_t, size_t);
    CALL(void, rtcCommitGeometry, void *);
    CALL(unsigned, rtcAttachGeometry, void *, void *);
    CALL(void, rtcCommitScene, void *);
    CALL(void, rtcIntersect1, void *, void *, void *);
    CALL(void, rtcOccluded1, void *, void *, void *);
    CALL(void, rtcIntersect8, const int *, void *, void *, void *);
    CALL(void, rtcOccluded8, const int *, void *, void *, void *);
    CALL(void, rtcIntersect16, const int *, void *, void *, void *);
    CALL(void, rtcOccluded16, const int *, void *, void *, void *);
    if (!rtcNewDevice || !rtcIntersect1 || !rtcOccluded1) return 2;
    size_t vertices, indices;
    float *v = whole(argv[2], "mesh.v", &vertices);
    unsigned *f = whole(argv[2], "mesh.f", &indices);
    void *device = rtcNewDevice("threads=1");
    void *scene = rtcNewScene(device);
    void *mesh = rtcNewGeometry(device, 0);
    rtcSetSharedGeometryBuffer(mesh, 0, 0, 0x5003, f, 0, 12, indices / 12);
    rtcSetSharedGeometryBuffer(mesh, 1, 0, 0x9003, v, 0, 12, vertices / 12);
    rtcCommitGeometry(mesh);
    rtcAttachGeometry(scene, mesh);
    double start = seconds();
    rtcCommitScene(scene);
    printf("build - %.6f 0\n", seconds() - start);
    const char *names[] = {"camera", "random", "bounce", "tiles", "shadow"};
    for (int k = 0; k < 5; k++) {
        char name[64];
        size_t size, hits = 0, blocked = 0;
        snprintf(name, sizeof name, "%s.rays", names[k]);
        float *rays = whole(argv[2], name, &size);
        size_t n = size / 32;
        start = seconds();
        for (size_t i = 0; i < n; i++) {
            RayHit ray;
            fill(&ray, rays + 8 * i);
            rtcIntersect1(scene, &ray, 0);
            hits += ray.geometry != ~0u;
        }
        printf("%s closest %.6f %zu\n", names[k], seconds() - start, hits);
        start = seconds();
        for (size_t i = 0; i < n; i++) {
            RayHit ray;
            fill(&ray, rays + 8 * i);
            rtcOccluded1(scene, &ray, 0);
            blocked += ray.tfar < 0;
        }
        printf("%s any %.6f %zu\n", names[k], seconds() - start, blocked);
        /* The calls of packets are absent from libraries that were built without them. */
        for (int way = 0; way < 8 && rtcIntersect8 && rtcOccluded8 && rtcIntersect16 && rtcOccluded16; way++) {
            int any = way & 1;
            /* The hint is RTC_RAY_QUERY_FLAG_COHERENT. All features are enabled. */
            Arguments arguments = {.flags = way & 2 ? 1u << 16 : 0, .features = ~0u};
            start = seconds();
            size_t found = way & 4 ? trace16(any ? rtcOccluded16 : rtcIntersect16, scene, rays, n, &arguments, any)
                                   : trace8(any ? rtcOccluded8 : rtcIntersect8, scene, rays, n, &arguments, any);
            printf("%s %s-packets %.6f %zu\n", names[k], any ? "any" : "closest", seconds() - start, found);
        }
        free(rays);
    }
    return 0;
}
