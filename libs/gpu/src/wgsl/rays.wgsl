// Tests of rays against boxes and triangles, and the traversal of a tree with eight children a node. The operations are
// those of the CPU, one by one, so that the hits are the same to the bit.
//
// Nodes have five vectors of four words: the origin of the grid, three exponents and the mask of inner children; the
// first inner child, the first triangle, and a byte for each child; then the planes of the children, a byte each, in
// the order lower x, upper x, lower y, upper y, lower z, upper z.

// What the rays of a run have in common.
struct World {
    // The power of two by which coordinates are scaled, and its reciprocal.
    factor: f32,
    inverse_factor: f32,
    infinity: f32,
    // The number of rays or points.
    count: u32,
    lo: array<f32, 3>,
    // 1 when any hit is enough.
    any: u32,
    hi: array<f32, 3>,
    // The number of points.
    points: u32,
}

@group(0) @binding(0) var<storage, read> world: World;

struct Ray {
    origin: vec3<f32>,
    tmin: f32,
    dir: vec3<f32>,
    tmax: f32,
    time: f32,
}

struct Best {
    t: f32,
    number: u32,
    b1: f32,
    b2: f32,
}

// A ray misses, hits, or must be traced by the CPU.
const MISSES: u32 = 0u;
const HITS: u32 = 1u;
const UNUSUAL: u32 = 2u;

// The values of a ray that are the same for all boxes and triangles.
var<private> near_origin: vec3<f32>;
var<private> far_origin: vec3<f32>;
var<private> inverse: vec3<f32>;
// The axes, the last of which is the ray's longest. The other values are in this order.
var<private> axes: vec3<u32>;
var<private> origin: vec3<f32>;
var<private> shear_x: f32;
var<private> shear_y: f32;
var<private> exact_x: f64;
var<private> exact_y: f64;
var<private> exact_z: f64;
var<private> tmin: f32;
var<private> best: Best;

fn largest(v: vec3<f32>) -> f32 {
    return max(abs_of(v.x), max(abs_of(v.y), abs_of(v.z)));
}

// A component, without memory that is indexed.
fn component(v: vec3<f32>, k: u32) -> f32 {
    return select(select(v.x, v.y, k == 1u), v.z, k == 2u);
}

fn is_finite3(v: vec3<f32>) -> bool {
    return is_finite(v.x) && is_finite(v.y) && is_finite(v.z);
}

// Prepares a ray. Returns `MISSES` for one that hits nothing, `HITS` for one to be traced, or `UNUSUAL`.
fn prepare(ray: Ray) -> u32 {
    let finite = is_finite3(ray.origin) && is_finite3(ray.dir) && is_finite(ray.time);
    let size = largest(ray.dir);
    let empty = is_nan(ray.tmin) || is_nan(ray.tmax) || is_less(ray.tmax, ray.tmin);
    if (!finite || empty || (bitcast<u32>(size) << 1u) == 0u) {
        return MISSES;
    }
    let o = ray.origin * world.factor;
    let far = largest(o);
    if (!(size >= 1e-6f && size < 1e6f && far <= 4.0f)) {
        return UNUSUAL;
    }
    let lo = vec3<f32>(world.lo[0], world.lo[1], world.lo[2]);
    let hi = vec3<f32>(world.hi[0], world.hi[1], world.hi[2]);
    let reach = max(largest(lo - o), largest(hi - o));
    let room = reach * 9.5367431640625e-7f + far * 1.1920928955078125e-7f;
    inverse = vec3<f32>(div(1.0f, ray.dir.x), div(1.0f, ray.dir.y), div(1.0f, ray.dir.z));
    let moved = vec3<f32>(copysign(room, inverse.x), copysign(room, inverse.y), copysign(room, inverse.z));
    near_origin = o + moved;
    far_origin = o - moved;
    let x = abs_of(ray.dir.x);
    let y = abs_of(ray.dir.y);
    let z = abs_of(ray.dir.z);
    let longest = select(select(0u, 1u, y > x), 2u, z > max(x, y));
    let next = select(longest + 1u, 0u, longest == 2u);
    axes = vec3<u32>(next, select(next + 1u, 0u, next == 2u), longest);
    exact_z = wide_div(1.0lf, f64(component(ray.dir, axes.z)));
    exact_x = f64(component(ray.dir, axes.x)) * exact_z;
    exact_y = f64(component(ray.dir, axes.y)) * exact_z;
    shear_x = f32(exact_x);
    shear_y = f32(exact_y);
    origin = vec3<f32>(component(o, axes.x), component(o, axes.y), component(o, axes.z));
    tmin = ray.tmin * world.factor;
    best = Best(ray.tmax * world.factor, 0xffffffffu, 0.0f, 0.0f);
    return HITS;
}

// The distances at which the line of the ray enters and leaves a box.
struct Span {
    near: f32,
    far: f32,
}

// Shortens a span to that of a box. A NaN changes nothing.
fn narrowed(span: Span, lo: vec3<f32>, hi: vec3<f32>) -> Span {
    let backwards = (bitcast<vec3<u32>>(inverse) >> vec3<u32>(31u)) == vec3<u32>(1u);
    let n = (select(lo, hi, backwards) - near_origin) * inverse;
    let f = (select(hi, lo, backwards) - far_origin) * inverse;
    var near = span.near;
    var far = span.far;
    near = select(near, n.x, n.x > near);
    near = select(near, n.y, n.y > near);
    near = select(near, n.z, n.z > near);
    far = select(far, f.x, f.x < far);
    far = select(far, f.y, f.y < far);
    far = select(far, f.z, f.z < far);
    return Span(near, far);
}

// Returns the children of a node that the ray enters up to the best hit so far: inner ones in the upper eight bits, the
// nearest first, and triangles in the others.
struct Entered {
    inner: vec2<u32>,
    leaves: vec2<u32>,
}

fn enter(index: u32, octant: u32) -> Entered {
    let a = node_at(index, 0u);
    let b = node_at(index, 1u);
    let px = node_at(index, 2u);
    let py = node_at(index, 3u);
    let pz = node_at(index, 4u);
    let low = bitcast<vec3<f32>>(a.xyz);
    let step = bitcast<vec3<f32>>((vec3<u32>(a.w, a.w >> 8u, a.w >> 16u) & vec3<u32>(255u)) << vec3<u32>(23u));
    var mask = 0u;
    for (var k = 0u; k < 8u; k++) {
        let second = k >= 4u;
        let shift = (k & 3u) * 8u;
        let kind = (select(b.z, b.w, second) >> shift) & 255u;
        if (kind == 0u) {
            continue;
        }
        let lower = vec3<u32>(select(px.x, px.y, second), select(py.x, py.y, second), select(pz.x, pz.y, second));
        let upper = vec3<u32>(select(px.z, px.w, second), select(py.z, py.w, second), select(pz.z, pz.w, second));
        let lo = low + vec3<f32>((lower >> vec3<u32>(shift)) & vec3<u32>(255u)) * step;
        let hi = low + vec3<f32>((upper >> vec3<u32>(shift)) & vec3<u32>(255u)) * step;
        let span = narrowed(Span(tmin, best.t), lo, hi);
        if (span.near <= span.far) {
            // The five lower bits of a leaf are its first triangle, and those of an inner child 24 and its slot. The
            // upper three bits have a one for each triangle.
            let is_inner = (kind & 24u) == 24u;
            let place = select(kind & 31u, (kind & 31u) ^ octant, is_inner);
            mask |= (kind >> 5u) << place;
        }
    }
    return Entered(vec2<u32>(b.x, (mask & 0xff000000u) | (a.w >> 24u)), vec2<u32>(b.y, mask & 0x00ffffffu));
}

// A vertex relative to the ray, sheared so that the ray runs along z, in double precision.
struct Solid {
    x: f64,
    y: f64,
    depth: f64,
}

fn solid(q: vec3<f32>) -> Solid {
    let z = f64(q.z) - f64(origin.z);
    return Solid(
        (f64(q.x) - f64(origin.x)) - exact_x * z,
        (f64(q.y) - f64(origin.y)) - exact_y * z,
        z * exact_z
    );
}

// The same in single precision.
fn flat(q: vec3<f32>) -> vec2<f32> {
    let z = q.z - origin.z;
    return vec2<f32>((q.x - origin.x) - shear_x * z, (q.y - origin.y) - shear_y * z);
}

struct Edges {
    u: f64,
    v: f64,
    w: f64,
    inside: bool,
}

// The edge functions of a triangle around the origin.
fn edges(ax: f64, ay: f64, bx: f64, by: f64, cx: f64, cy: f64) -> Edges {
    let u = cx * by - cy * bx;
    let v = ax * cy - ay * cx;
    let w = bx * ay - by * ax;
    let low = u < 0.0lf || v < 0.0lf || w < 0.0lf;
    let high = u > 0.0lf || v > 0.0lf || w > 0.0lf;
    return Edges(u, v, w, low != high);
}

fn turned(q: vec3<f32>) -> vec3<f32> {
    return vec3<f32>(component(q, axes.x), component(q, axes.y), component(q, axes.z));
}

// Tests a triangle, and replaces the best hit by one that is nearer, or as near with a smaller number.
fn meet(index: u32) {
    let first = triangle_at(index, 0u);
    let p0 = bitcast<vec3<f32>>(first.xyz);
    let p1 = bitcast<vec3<f32>>(triangle_at(index, 1u).xyz);
    let p2 = bitcast<vec3<f32>>(triangle_at(index, 2u).xyz);
    let number = first.w;
    let q0 = turned(p0);
    let q1 = turned(p1);
    let q2 = turned(p2);
    let a = flat(q0);
    let b = flat(q1);
    let c = flat(q2);
    let u = c.x * b.y - c.y * b.x;
    let v = a.x * c.y - a.y * c.x;
    let w = b.x * a.y - b.y * a.x;
    let inside = (u >= 0.0f && v >= 0.0f && w >= 0.0f) || (u <= 0.0f && v <= 0.0f && w <= 0.0f);
    if (!inside) {
        return;
    }
    // The same in double precision, where products are exact.
    var weights = edges(f64(a.x), f64(a.y), f64(b.x), f64(b.y), f64(c.x), f64(c.y));
    if (!weights.inside) {
        return;
    }
    let s0 = solid(q0);
    let s1 = solid(q1);
    let s2 = solid(q2);
    // Near edges this test may find the point outside. It is then on the edge.
    let finer = edges(s0.x, s0.y, s1.x, s1.y, s2.x, s2.y);
    if (finer.inside) {
        weights = finer;
    }
    let scale = wide_div(1.0lf, weights.u + weights.v + weights.w);
    let plain = f32((weights.u * s0.depth + weights.v * s1.depth + weights.w * s2.depth) * scale);
    let span = narrowed(Span(neg(world.infinity), world.infinity), min(min(p0, p1), p2), max(max(p0, p1), p2));
    let t = select(plain, span.near, span.near > plain);
    if (span.near <= span.far && tmin <= span.far && t >= tmin && t <= best.t) {
        if (t < best.t || number < best.number) {
            best = Best(t, number, f32(weights.v * scale), f32(weights.w * scale));
        }
    }
}

// Finds the best hit of a ray: the closest one, or with `any` some hit.
fn trace(ray: Ray, any: bool) -> u32 {
    let state = prepare(ray);
    if (state != HITS) {
        return state;
    }
    let octant = select(0u, 4u, (bitcast<u32>(inverse.x) >> 31u) == 0u)
        | select(0u, 2u, (bitcast<u32>(inverse.y) >> 31u) == 0u)
        | select(0u, 1u, (bitcast<u32>(inverse.z) >> 31u) == 0u);
    var stack: array<vec2<u32>, STACK>;
    var size = 0u;
    // The root is the only child of a node that does not exist.
    var group = vec2<u32>(0u, 0x80000000u);
    loop {
        let bit = firstLeadingBit(group.y);
        let slot = (bit - 24u) ^ octant;
        let before = countOneBits(group.y & 255u & ~(0xffffffffu << slot));
        let child = group.x + before;
        group.y &= ~(1u << bit);
        if ((group.y & 0xff000000u) != 0u) {
            stack[size] = group;
            size += 1u;
        }
        let entered = enter(child, octant);
        group = entered.inner;
        var leaves = entered.leaves.y;
        while (leaves != 0u) {
            let k = firstTrailingBit(leaves);
            leaves &= leaves - 1u;
            meet(entered.leaves.x + k);
            if (any && best.number != 0xffffffffu) {
                return HITS;
            }
        }
        if ((group.y & 0xff000000u) == 0u) {
            if (size == 0u) {
                break;
            }
            size -= 1u;
            group = stack[size];
        }
    }
    return select(MISSES, HITS, best.number != 0xffffffffu);
}
