/* Measures Embree's single-ray calls alone: embree_rays LIBRARY FOLDER.
   Reads from FOLDER mesh.v (three floats per vertex), mesh.f (three indices per triangle) and NAME.rays (origin, least
   distance, direction, largest distance). Prints lines "NAME closest|any SECONDS HITS". The seconds are those of one
   thread. */
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
    const char *names[] = {"camera", "random", "bounce"};
    for (int k = 0; k < 3; k++) {
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
        free(rays);
    }
    return 0;
}
