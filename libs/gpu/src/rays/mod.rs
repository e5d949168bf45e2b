//! Rays against triangles that are resident on a device.

mod accelerator;
mod occlusion;
mod tree;

pub use accelerator::GpuAccelerator;
pub use occlusion::{Occluded, OcclusionPoint, occlusion_on_cpu};

use crate::functions::{DOUBLE, SINGLE};
use crate::{Access, Buffer, Device, GpuError, Kernel, Pages};
use granita_trace::{Hit, Ray, Tracer};
use std::fmt::Write;
use std::sync::Arc;
use tree::{NODE, TRIANGLE, Tree};

/// The number of words of a ray.
const RAY: usize = 9;
/// The number of words of a closest hit: the distance, the number of the triangle and two weights.
const HIT: usize = 4;

/// The number in place of a triangle's for a ray that hits nothing.
const MISS: u32 = u32::MAX;
/// The number for a ray that the CPU must trace. Its direction is very long or very short, or its origin is far away.
const UNUSUAL: u32 = u32::MAX - 1;

/// The text for the traversal of the tree.
const RAYS: &str = include_str!("../wgsl/rays.wgsl");

/// The triangles of a tracer on a device. It finds the hits that the tracer finds, to the bit, on adapters where all
/// functions of [`crate::selftest`] hold. It is shared between threads.
#[derive(Debug)]
pub struct GpuTracer {
    device: Arc<Device>,
    tracer: Arc<Tracer>,
    /// What rays need; `None` for a tracer without triangles.
    there: Option<There>,
}

/// The tree and the kernels on a device.
#[derive(Debug)]
struct There {
    nodes: Pages,
    triangles: Pages,
    kernel: Kernel,
    occlusion: Kernel,
    sums: Kernel,
    /// The words of the world that all runs share.
    world: [u32; 12],
}

/// The number of rays on a device, and the time there.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Traced {
    /// The number of rays.
    pub rays: u64,
    /// The part of them that the CPU traced.
    pub by_cpu: u64,
    /// The time on the device in seconds; 0 when the device does not measure time.
    pub seconds: f64,
}

impl GpuTracer {
    /// Makes the triangles of a tracer resident.
    ///
    /// # Errors
    /// Returns an error when the triangles move, when the adapter lacks numbers of 64 bits, when the tree is larger
    /// than the device's memory or needs more bindings than the adapter has, and when the device is lost.
    pub fn new(device: Arc<Device>, tracer: Arc<Tracer>) -> Result<Self, GpuError> {
        let abilities = device.adapter().abilities;
        if !abilities.trace_rays() {
            let what = abilities.names(false).join(", ");
            return Err(GpuError::Unsupported { adapter: device.adapter().name.clone(), what });
        }
        let Some(resident) = tracer.resident() else {
            return Err(GpuError::Unsupported {
                adapter: device.adapter().name.clone(),
                what: "tree of triangles that move".to_owned(),
            });
        };
        let tree = Tree::new(&resident)?;
        if tree.nodes.is_empty() {
            return Ok(Self { device, tracer, there: None });
        }
        let nodes = Pages::of(&device, "bytes of nodes", &tree.nodes, NODE)?;
        let triangles = Pages::of(&device, "bytes of triangles", &tree.triangles, TRIANGLE)?;
        let [lo, hi] = resident.bounds.map(|corner| corner.map(f32::to_bits));
        let world = [
            resident.factor.to_bits(),
            (1.0 / resident.factor).to_bits(),
            f32::INFINITY.to_bits(),
            0,
            lo[0],
            lo[1],
            lo[2],
            0,
            hi[0],
            hi[1],
            hi[2],
            0,
        ];
        let stack = format!("const STACK: u32 = {}u;\n", tree.levels.max(1));
        let compile = |name: &str, first: &[Access], text: &str| {
            let binding = first.len();
            let nodes_text = pages("node_at", "nodes", binding, &nodes, NODE / 4);
            let after = binding + nodes.buffers().len();
            let triangles_text = pages("triangle_at", "triangles", after, &triangles, TRIANGLE / 4);
            let text = [SINGLE, DOUBLE, &stack, RAYS, &nodes_text, &triangles_text, text].concat();
            let count = nodes.buffers().len() + triangles.buffers().len();
            let bindings: Vec<Access> =
                first.iter().copied().chain(std::iter::repeat_n(Access::Read, count)).collect();
            Kernel::new(&device, name, &text, &bindings)
        };
        let three = [Access::Read, Access::Read, Access::Write];
        let kernel = compile("rays", &three, &entry(RAYS_MAIN))?;
        let occlusion = compile("occlusion", &three, &entry(occlusion::MAIN))?;
        let sums = occlusion::sums(&device)?;
        let there = There { nodes, triangles, kernel, occlusion, sums, world };
        Ok(Self { device, tracer, there: Some(there) })
    }

    /// The number of bytes of the tree on the device.
    pub fn bytes(&self) -> u64 {
        self.there.as_ref().map_or(0, |t| t.nodes.bytes() + t.triangles.bytes())
    }

    /// Finds the closest hit of each ray, as [`Tracer::closest`].
    ///
    /// # Errors
    /// Returns an error when the memory is used up or the device is lost. `hits` is then incomplete.
    ///
    /// # Panics
    /// Panics when `hits` is not as long as `rays`.
    pub fn closest(&self, rays: &[Ray], hits: &mut [Hit]) -> Result<Traced, GpuError> {
        assert_eq!(rays.len(), hits.len(), "as many hits as rays");
        hits.fill(Hit::MISS);
        self.trace(rays, HIT, &mut |traced, first, words| {
            for (k, hit) in words.as_chunks::<HIT>().0.iter().enumerate() {
                let [t, number, b1, b2] = *hit;
                hits[first + k] = match number {
                    MISS => continue,
                    UNUSUAL => {
                        traced.by_cpu += 1;
                        self.tracer.closest_of_one(&rays[first + k], &mut Default::default())
                    }
                    number => {
                        let [t, b1, b2] = [t, b1, b2].map(f32::from_bits);
                        self.tracer.hit_of(number, t, [b1, b2])
                    }
                };
            }
        })
    }

    /// Determines whether each ray hits anything, as [`Tracer::any`].
    ///
    /// # Errors
    /// Returns an error when the memory is used up or the device is lost. `blocked` is then incomplete.
    ///
    /// # Panics
    /// Panics when `blocked` is not as long as `rays`.
    pub fn any(&self, rays: &[Ray], blocked: &mut [bool]) -> Result<Traced, GpuError> {
        assert_eq!(rays.len(), blocked.len(), "as many answers as rays");
        blocked.fill(false);
        self.trace(rays, 1, &mut |traced, first, words| {
            for (k, state) in words.iter().enumerate() {
                blocked[first + k] = match *state {
                    2 => {
                        traced.by_cpu += 1;
                        self.tracer.any_of_one(&rays[first + k], &mut Default::default())
                    }
                    state => state == 1,
                };
            }
        })
    }

    /// Traces rays in batches. `take` receives the index of the first ray of each, and `width` words of each ray.
    fn trace(
        &self,
        rays: &[Ray],
        width: usize,
        take: &mut dyn FnMut(&mut Traced, usize, &[u32]),
    ) -> Result<Traced, GpuError> {
        let mut traced = Traced { rays: rays.len() as u64, ..Traced::default() };
        self.device.check()?;
        let Some(there) = &self.there else { return Ok(traced) };
        if rays.is_empty() {
            return Ok(traced);
        }
        let batch = self.batch(RAY).min(rays.len());
        let from = Buffer::zeroed(&self.device, "bytes of rays", (batch * RAY) as u64)?;
        let to = Buffer::zeroed(&self.device, "bytes of hits", (batch * width) as u64)?;
        let world = Buffer::zeroed(&self.device, "bytes of a world", there.world.len() as u64)?;
        for (n, part) in rays.chunks(batch).enumerate() {
            let words: Vec<u32> = part.iter().flat_map(words_of).collect();
            from.write(&self.device, &words)?;
            let mut own = there.world;
            (own[3], own[7]) = (part.len() as u32, u32::from(width == 1));
            world.write(&self.device, &own)?;
            let buffers = there.buffers([&world, &from, &to]);
            traced.seconds += there.kernel.run(&self.device, &buffers, part.len() as u32)?;
            take(&mut traced, n * batch, &to.read(&self.device, part.len() * width)?);
        }
        Ok(traced)
    }

    /// The number of records of this number of words in a batch.
    fn batch(&self, words: usize) -> usize {
        let limits = self.device.limits();
        let fit = limits.binding_bytes / (words as u64 * 4);
        (fit as usize).min(limits.batch as usize).max(1)
    }
}

impl There {
    /// Returns the buffers of a kernel: some of its own, and those of the tree.
    fn buffers<'b>(&'b self, own: [&'b Buffer; 3]) -> Vec<&'b Buffer> {
        own.into_iter().chain(self.nodes.buffers()).chain(self.triangles.buffers()).collect()
    }
}

/// Returns the words of a ray.
fn words_of(ray: &Ray) -> [u32; RAY] {
    let ([ox, oy, oz], [dx, dy, dz]) = (ray.origin.to_array(), ray.dir.to_array());
    [ox, oy, oz, ray.tmin, dx, dy, dz, ray.tmax, ray.time].map(f32::to_bits)
}

/// Returns an entry point around the text of an invocation `i`.
fn entry(text: &str) -> String {
    text.replace("GROUP", &Kernel::GROUP.to_string())
        .replace("ROW", &format!("{}u", Kernel::GROUP * Kernel::ROW))
}

/// Returns the bindings of pages from `first` on, and a function that reads `width` vectors of a record.
fn pages(function: &str, name: &str, first: usize, pages: &Pages, width: usize) -> String {
    let mut text = String::new();
    let n = pages.buffers().len();
    for k in 0..n {
        let binding = first + k;
        // Writing to a string does not fail.
        let _ =
            writeln!(text, "@group(0) @binding({binding}) var<storage, read> {name}{k}: array<vec4<u32>>;");
    }
    let _ = writeln!(text, "\nfn {function}(index: u32, k: u32) -> vec4<u32> {{");
    if n > 1 {
        let mask = (1_u64 << pages.shift()) - 1;
        let _ = writeln!(text, "    let at = (index & {mask}u) * {width}u + k;");
        let _ = writeln!(text, "    switch index >> {}u {{", pages.shift());
        for k in 1..n {
            let _ = writeln!(text, "        case {k}u: {{ return {name}{k}[at]; }}");
        }
        let _ = writeln!(text, "        default: {{ return {name}0[at]; }}\n    }}\n}}");
    } else {
        let _ = writeln!(text, "    return {name}0[index * {width}u + k];\n}}");
    }
    text
}

/// The entry point for rays that are given.
const RAYS_MAIN: &str = "
@group(0) @binding(1) var<storage, read> rays: array<u32>;
@group(0) @binding(2) var<storage, read_write> results: array<u32>;

@compute @workgroup_size(GROUP)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    let i = id.x + id.y * ROW;
    if (i >= world.count) {
        return;
    }
    let at = i * 9u;
    let ray = Ray(
        vec3<f32>(bitcast<f32>(rays[at]), bitcast<f32>(rays[at + 1u]), bitcast<f32>(rays[at + 2u])),
        bitcast<f32>(rays[at + 3u]),
        vec3<f32>(bitcast<f32>(rays[at + 4u]), bitcast<f32>(rays[at + 5u]), bitcast<f32>(rays[at + 6u])),
        bitcast<f32>(rays[at + 7u]),
        bitcast<f32>(rays[at + 8u])
    );
    let state = trace(ray, world.any != 0u);
    if (world.any != 0u) {
        results[i] = state;
        return;
    }
    let to = i * 4u;
    // The CPU adds 0 before it divides, unless the units are equal. So -0 becomes 0.
    let scaled = bitcast<u32>(f32(f64(best.t) * f64(world.inverse_factor)));
    let unsigned = select(scaled, 0u, scaled == 0x80000000u);
    results[to] = select(unsigned, bitcast<u32>(best.t), world.factor == 1.0f);
    results[to + 1u] = select(select(0xffffffffu, best.number, state == HITS), 0xfffffffeu, state == UNUSUAL);
    results[to + 2u] = bitcast<u32>(best.b1);
    results[to + 3u] = bitcast<u32>(best.b2);
}
";
