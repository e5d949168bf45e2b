// The directions of occlusion: one in each cell of a cone, as `granita_rays::sampling::ConeCells` makes them.

struct Point {
    p: array<f32, 3>,
    tmin: f32,
    axis: array<f32, 3>,
    tmax: f32,
    rings: u32,
    sectors: u32,
    // The sine of the half angle of a cone with cells of equal weight by the cosine.
    sin: f32,
    // The cosine of the half angle of a cone with cells of equal solid angle.
    narrowest: f32,
    seed: u32,
    // The index of the first ray.
    first: u32,
    // 0: all directions are the axis; 1: cells weighted by the cosine; 2: cells of equal solid angle.
    kind: u32,
    time: f32,
}

fn mix32(h: u32) -> u32 {
    var x = h;
    x ^= x >> 16u;
    x = x * 0x7feb352du;
    x ^= x >> 15u;
    x = x * 0x846ca68bu;
    return x ^ (x >> 16u);
}

fn add_word(h: u32, word: u32) -> u32 {
    return mix32(h ^ word) + 0x9e3779b9u;
}

fn two_words(a: u32, b: u32) -> u32 {
    return mix32(add_word(add_word(0x9e3779b9u, a), b));
}

fn three_words(a: u32, b: u32, c: u32) -> u32 {
    return mix32(add_word(add_word(add_word(0x9e3779b9u, a), b), c));
}

fn unit(h: u32) -> f32 {
    return f32(h >> 8u) * 5.9604644775390625e-8f;
}

// The image of `k` under a hashed permutation of 0 to n - 1.
fn permute(k: u32, n: u32, seed: u32) -> u32 {
    if (n <= 1u) {
        return 0u;
    }
    let w = (0xffffffffu >> countLeadingZeros(n - 1u));
    var i = k;
    loop {
        i ^= seed;
        i = i * 0xe170893du;
        i ^= seed >> 16u;
        i ^= (i & w) >> 4u;
        i ^= seed >> 8u;
        i = i * 0x0929eb3fu;
        i ^= seed >> 23u;
        i ^= (i & w) >> 1u;
        i = i * (1u | (seed >> 27u));
        i = i * 0x6935fa69u;
        i ^= (i & w) >> 11u;
        i = i * 0x74dcb303u;
        i ^= (i & w) >> 2u;
        i = i * 0x9e501cc3u;
        i ^= (i & w) >> 2u;
        i = i * 0xc860a3dfu;
        i &= w;
        i ^= i >> 5u;
        if (i < n) {
            break;
        }
    }
    return (i + seed) % n;
}

fn part(k: u32, of_all: u32, seed: u32, index: u32, dimension: u32) -> f32 {
    return div(f32(k) + unit(three_words(seed, index, dimension)), f32(of_all));
}

fn direction(point: Point, index: u32) -> vec3<f32> {
    let nx = point.axis[0];
    let ny = point.axis[1];
    let nz = point.axis[2];
    let axis = vec3<f32>(nx, ny, nz);
    if (point.kind == 0u) {
        return axis;
    }
    let ring = index / point.sectors;
    let sector = index % point.sectors;
    let across = permute(sector, point.sectors, two_words(point.seed, 1u));
    let around = permute(ring, point.rings, two_words(point.seed, 2u));
    let jx = part(across, point.sectors, point.seed, index, 3u);
    let jy = part(around, point.rings, point.seed, index, 4u);
    let x = div(f32(ring) + jx, f32(point.rings));
    let y = div(f32(sector) + jy, f32(point.sectors));
    var sin = point.sin * root(x);
    var cos = root(max(1.0f - sin * sin, 0.0f));
    if (point.kind == 2u) {
        cos = 1.0f - x * (1.0f - point.narrowest);
        sin = root(max(1.0f - cos * cos, 0.0f));
    }
    let turn = y * 6.28318531f;
    let s = sin * sin_near(turn);
    let c = sin * cos_near(turn);
    // Two unit vectors perpendicular to the axis and to each other.
    let sign = copysign(1.0f, nz);
    let a = div(-1.0f, sign + nz);
    let b = nx * ny * a;
    let ux = 1.0f + sign * nx * nx * a;
    let uy = sign * b;
    let uz = neg(sign) * nx;
    let vx = b;
    let vy = sign + ny * ny * a;
    let vz = neg(ny);
    let dx = ux * c + vx * s + nx * cos;
    let dy = uy * c + vy * s + ny * cos;
    let dz = uz * c + vz * s + nz * cos;
    let scale = div(1.0f, root(dx * dx + dy * dy + dz * dz));
    if (is_finite(scale) && scale > 0.0f) {
        return vec3<f32>(dx * scale, dy * scale, dz * scale);
    }
    return axis;
}
