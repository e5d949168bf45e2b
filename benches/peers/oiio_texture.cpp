// Measures OpenImageIO's texture lookups alone: oiio_texture TEXTURE LOOKUPS RESULTS CHANNELS [RUNS [NAME]].
//
// LOOKUPS holds six floats for each lookup: s t ds/dx dt/dx ds/dy dt/dy. The program prints a line
// "NAME THREADS SECONDS WALL" for each way of filtering, with one thread and with two. SECONDS is the processor time of
// the slower thread, and WALL is the wall clock time. Both are the best of RUNS (ten) runs. For each way of filtering, or
// the one of the NAME, it appends the values of all lookups to RESULTS.
#include <OpenImageIO/texture.h>

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <ctime>
#include <thread>
#include <vector>

using namespace OIIO;

static double seconds(clockid_t clock)
{
    timespec t;
    clock_gettime(clock, &t);
    return double(t.tv_sec) + 1e-9 * double(t.tv_nsec);
}

struct Way {
    const char* name;
    TextureOpt::MipMode mip;
    TextureOpt::InterpMode interp;
    int anisotropic;
};

int main(int argc, char** argv)
{
    if (argc < 5)
        return 2;
    FILE* in = std::fopen(argv[2], "rb");
    FILE* out = std::fopen(argv[3], "wb");
    if (!in || !out)
        return 2;
    std::vector<float> q;
    for (float v[6]; std::fread(v, sizeof v, 1, in) == 1;)
        q.insert(q.end(), v, v + 6);
    const size_t count = q.size() / 6;
    const int channels = std::atoi(argv[4]);
    const int runs = argc > 5 ? std::atoi(argv[5]) : 10;
    const char* only = argc > 6 ? argv[6] : nullptr;
    auto system = TextureSystem::create(false);
    system->attribute("max_memory_MB", 1024.0f);
    const ustring name(argv[1]);
    const Way ways[] = {
        { "trilinear16", TextureOpt::MipModeTrilinear, TextureOpt::InterpBilinear, 16 },
        { "trilinear64", TextureOpt::MipModeTrilinear, TextureOpt::InterpBilinear, 64 },
        { "anisotropic32", TextureOpt::MipModeAniso, TextureOpt::InterpSmartBicubic, 32 },
        { "anisotropic64", TextureOpt::MipModeAniso, TextureOpt::InterpBilinear, 64 },
        { "bicubic64", TextureOpt::MipModeAniso, TextureOpt::InterpBicubic, 64 },
    };
    std::vector<float> values(count * channels);
    for (const Way& way : ways) {
        if (only && std::strcmp(only, way.name) != 0)
            continue;
        auto some = [&](size_t from, size_t to, double* took) {
            const double start = seconds(CLOCK_THREAD_CPUTIME_ID);
            auto* thread = system->get_perthread_info();
            auto* handle = system->get_texture_handle(name, thread);
            TextureOpt opt;
            opt.swrap = opt.twrap = TextureOpt::WrapPeriodic;
            opt.mipmode = way.mip;
            opt.interpmode = way.interp;
            opt.anisotropic = way.anisotropic;
            for (size_t i = from; i < to; ++i) {
                const float* f = &q[6 * i];
                if (!system->texture(handle, thread, opt, f[0], f[1], f[2], f[3], f[4], f[5], channels,
                                     &values[i * channels]))
                    std::exit(3);
            }
            *took = seconds(CLOCK_THREAD_CPUTIME_ID) - start;
        };
        for (int threads : { 1, 2 }) {
            double best = 1e30, wall = 1e30;
            for (int run = 0; run < runs; ++run) {
                double took[2] = { 0, 0 };
                const double start = seconds(CLOCK_MONOTONIC);
                if (threads == 1) {
                    some(0, count, &took[0]);
                } else {
                    std::thread other(some, 0, count / 2, &took[1]);
                    some(count / 2, count, &took[0]);
                    other.join();
                }
                wall = std::min(wall, seconds(CLOCK_MONOTONIC) - start);
                best = std::min(best, std::max(took[0], took[1]));
            }
            std::printf("%s %d %.6f %.6f\n", way.name, threads, best, wall);
        }
        std::fwrite(values.data(), sizeof(float), values.size(), out);
    }
    std::fclose(out);
    return 0;
}
