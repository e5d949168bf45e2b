//! Occlusion: rays around points, made and counted on the device.

use super::{GpuTracer, Traced, entry};
use crate::functions::{DOUBLE, SINGLE};
use crate::{Access, Buffer, Device, GpuError, Kernel};
use granita_base::Vec3;
use granita_base::sample::Sequence;
use granita_rays::sampling::ConeCells;
use granita_trace::{Ray, Tracer};

/// The text for the directions of rays.
const CELLS: &str = include_str!("../wgsl/cells.wgsl");

/// The number of words of a point.
const POINT: usize = 16;
/// The number of words of a result: the blocked rays, those for the CPU, and the sum of directions.
const SUM: usize = 5;

/// A point whose occlusion is sampled.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OcclusionPoint {
    /// The origin of the rays.
    pub p: Vec3,
    /// The unit axis of the cone.
    pub axis: Vec3,
    /// The smallest distance of a hit.
    pub tmin: f32,
    /// The largest distance of a hit; may be infinite.
    pub tmax: f32,
    /// The time of the rays.
    pub time: f32,
    /// The cells of the cone. Each has one ray.
    pub cells: ConeCells,
    /// The seed of the directions within the cells.
    pub seed: u32,
}

/// The occlusion of a point.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Occluded {
    /// The number of rays.
    pub rays: u32,
    /// The number of rays that hit something.
    pub blocked: u32,
    /// The sum of the directions of the other rays, in the order of the cells.
    pub open: Vec3,
}

impl OcclusionPoint {
    fn ray(&self, dir: Vec3) -> Ray {
        Ray { origin: self.p, tmin: self.tmin, dir, tmax: self.tmax, time: self.time }
    }

    fn words(&self, first: u32) -> [u32; POINT] {
        let ([px, py, pz], [nx, ny, nz]) = (self.p.to_array(), self.axis.to_array());
        let c = &self.cells;
        let kind = if c.is_narrow() { 0 } else { 1 + u32::from(c.uniform.is_some()) };
        let bits = f32::to_bits;
        [
            bits(px),
            bits(py),
            bits(pz),
            bits(self.tmin),
            bits(nx),
            bits(ny),
            bits(nz),
            bits(self.tmax),
            c.rings,
            c.sectors,
            bits(c.sin),
            bits(c.narrowest()),
            self.seed,
            first,
            kind,
            bits(self.time),
        ]
    }
}

/// Returns the occlusion of a point, computed by the CPU.
pub fn occlusion_on_cpu(tracer: &Tracer, point: &OcclusionPoint) -> Occluded {
    let mut rays = Vec::with_capacity(point.cells.count() as usize);
    point.cells.directions(point.axis, Sequence::new(point.seed), &mut |_, dir| rays.push(point.ray(dir)));
    let mut blocked = vec![false; rays.len()];
    tracer.any(&rays, &mut blocked);
    let mut out = Occluded { rays: rays.len() as u32, ..Occluded::default() };
    for (ray, blocked) in rays.iter().zip(blocked) {
        if blocked {
            out.blocked += 1;
        } else {
            out.open += ray.dir;
        }
    }
    out
}

impl GpuTracer {
    /// Samples the occlusion of points. The rays are made, traced and counted on the device.
    ///
    /// # Errors
    /// Returns an error when a point has more rays than fit into a batch, when the memory is used up or the device is
    /// lost.
    pub fn occlusion(&self, points: &[OcclusionPoint]) -> Result<(Vec<Occluded>, Traced), GpuError> {
        let mut traced = Traced::default();
        let mut out = Vec::with_capacity(points.len());
        self.device.check()?;
        let Some(there) = &self.there else {
            out.extend(points.iter().map(|p| occlusion_on_cpu(&self.tracer, p)));
            return Ok((out, traced));
        };
        let (most_rays, most_points) = (self.batch(1), self.batch(POINT));
        let mut rest = points;
        while !rest.is_empty() {
            // As many points as their rays fit.
            let (mut words, mut rays, mut n) = (Vec::new(), 0_usize, 0);
            for point in rest.iter().take(most_points) {
                let own = point.cells.count() as usize;
                if rays + own > most_rays {
                    break;
                }
                words.extend(point.words(rays as u32));
                rays += own;
                n += 1;
            }
            let (now, later) = rest.split_at(n);
            rest = later;
            if now.is_empty() {
                let asked = rest.first().map_or(0, |p| u64::from(p.cells.count()));
                return Err(GpuError::Limit { what: "rays of a point", asked, most: most_rays as u64 });
            }
            let device = &*self.device;
            let from = Buffer::of(device, "bytes of points", &words)?;
            let states = Buffer::zeroed(device, "bytes of answers", rays as u64)?;
            let to = Buffer::zeroed(device, "bytes of sums", (n * SUM) as u64)?;
            let mut own = there.world;
            (own[3], own[7], own[11]) = (rays as u32, 1, n as u32);
            let world = Buffer::of(device, "bytes of a world", &own)?;
            let buffers = there.buffers([&world, &from, &states]);
            traced.rays += rays as u64;
            traced.seconds += there.occlusion.run(device, &buffers, rays as u32)?;
            traced.seconds += there.sums.run(device, &[&world, &from, &states, &to], n as u32)?;
            let sums = to.read(device, n * SUM)?;
            for (point, sum) in now.iter().zip(sums.as_chunks::<SUM>().0) {
                let [blocked, unusual, x, y, z] = *sum;
                if unusual > 0 {
                    traced.by_cpu += u64::from(point.cells.count());
                    out.push(occlusion_on_cpu(&self.tracer, point));
                    continue;
                }
                let open = Vec3::from_array([x, y, z].map(f32::from_bits));
                out.push(Occluded { rays: point.cells.count(), blocked, open });
            }
        }
        Ok((out, traced))
    }
}

/// Compiles the kernel that counts the answers of rays.
pub(super) fn sums(device: &Device) -> Result<Kernel, GpuError> {
    // The structure of the world stands at the beginning of the text for rays.
    let world = super::RAYS.split_once("struct Ray {").map_or("", |(world, _)| world);
    let text = [SINGLE, DOUBLE, world, CELLS, &entry(SUMS)].concat();
    Kernel::new(device, "sums", &text, &[Access::Read, Access::Read, Access::Read, Access::Write])
}

/// The entry point for rays around points, after the text of [`CELLS`].
pub(super) const MAIN: &str = concat!(
    include_str!("../wgsl/cells.wgsl"),
    "
@group(0) @binding(1) var<storage, read> points: array<Point>;
@group(0) @binding(2) var<storage, read_write> states: array<u32>;

@compute @workgroup_size(GROUP)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    let i = id.x + id.y * ROW;
    if (i >= world.count) {
        return;
    }
    // The last point whose first ray is not behind this one.
    var low = 0u;
    var high = world.points;
    while (high - low > 1u) {
        let middle = (low + high) / 2u;
        if (points[middle].first <= i) {
            low = middle;
        } else {
            high = middle;
        }
    }
    let point = points[low];
    let d = direction(point, i - point.first);
    let p = vec3<f32>(point.p[0], point.p[1], point.p[2]);
    let ray = Ray(p, point.tmin, d, point.tmax, point.time);
    states[i] = trace(ray, true);
}
"
);

/// The entry point that adds the answers of the rays of each point.
const SUMS: &str = "
@group(0) @binding(1) var<storage, read> points: array<Point>;
@group(0) @binding(2) var<storage, read> states: array<u32>;
@group(0) @binding(3) var<storage, read_write> sums: array<u32>;

@compute @workgroup_size(GROUP)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    let i = id.x + id.y * ROW;
    if (i >= world.points) {
        return;
    }
    let point = points[i];
    let count = point.rings * point.sectors;
    var blocked = 0u;
    var unusual = 0u;
    var x = 0.0f;
    var y = 0.0f;
    var z = 0.0f;
    for (var k = 0u; k < count; k++) {
        let state = states[point.first + k];
        if (state == 1u) {
            blocked += 1u;
        } else if (state == 2u) {
            unusual += 1u;
        } else {
            let d = direction(point, k);
            x = x + d.x;
            y = y + d.y;
            z = z + d.z;
        }
    }
    let to = i * 5u;
    sums[to] = blocked;
    sums[to + 1u] = unusual;
    sums[to + 2u] = bitcast<u32>(x);
    sums[to + 3u] = bitcast<u32>(y);
    sums[to + 4u] = bitcast<u32>(z);
}
";
