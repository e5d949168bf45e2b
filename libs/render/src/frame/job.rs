//! Primitives in view, and their splits into grids.

use super::kept::{GridId, MadeGrid};
use super::limits::{Budget, POINTS_OF_A_SPLIT};
use super::{Frame, FrameShader, ObjectTraits};
use crate::PixelRect;
use crate::preshaded::MOST_POINTS;
use crate::statistics::add;
use granita_base::{Bound, ParamData, Params, Severity, hash, parallel_map};
use granita_dicing::camera::MAX_QUALITY;
use granita_dicing::{DiceSettings, Leaf, Placement, Plan, Rates, largest_coordinates, trimming};
use granita_geom::{Piece, ShapeKey, SplitDirection, Surface};
use granita_hider::ShadedGrid;
use granita_scene::{Primitive, attr};
use granita_shading::preshaded;
use parking_lot::{Mutex, MutexGuard};
use std::sync::atomic::{AtomicU32, AtomicU64, Ordering};
use std::sync::{Arc, OnceLock};

/// A primitive that is in view.
pub(super) struct Job<O> {
    /// The number of the primitive in the scene.
    pub(super) number: u32,
    pub(super) primitive: Arc<Primitive>,
    pub(super) object: Arc<O>,
    pub(super) traits: ObjectTraits,
    pub(super) settings: DiceSettings,
    pub(super) placement: Placement,
    /// For each eye: the pixels in which it may be visible.
    pub(super) seen: Box<[Sighting]>,
    pub(super) culls_hidden: bool,
    /// The time at which it is split, diced and shaded.
    pub(super) time: f32,
    /// Further times at which its grids are shaded, because primitive variables change over the shutter.
    pub(super) later: Vec<f32>,
    /// The times between which it exists; `None` for the whole shutter.
    pub(super) existence: Option<[f32; 2]>,
    budget: Budget,
    /// Its pieces, until they are split.
    pieces: Mutex<Vec<Piece>>,
    split: OnceLock<Split>,
    /// The eyes and buckets that released it before it was split; `None` after the split.
    passed: Mutex<Option<Vec<(usize, u32)>>>,
}

/// The grids of a primitive.
pub(super) struct Split {
    pub(super) leaves: Vec<LeafSlot>,
    /// For each eye: pairs of a block of buckets and a leaf, sorted. The bound of a displaced grid touches many
    /// buckets, and a pair for each of them would take more memory than the grids.
    of_block: Vec<Vec<(u32, u32)>>,
}

impl Split {
    /// Releases all leaves of a bucket for an eye.
    fn release(&self, eye: usize, place: &Place) {
        self.leaves_of(eye, *place).for_each(|leaf| self.leaves[leaf as usize].release(eye, place));
    }

    /// Returns the leaves that may be visible to an eye in a bucket, in order.
    pub(super) fn leaves_of(&self, eye: usize, place: Place) -> impl Iterator<Item = u32> + '_ {
        let of_block = &self.of_block[eye];
        let from = of_block.partition_point(|(block, _)| *block < place.block);
        let here = of_block[from..].iter().take_while(move |(block, _)| *block == place.block);
        let touches = move |leaf: &u32| self.leaves[*leaf as usize].seen[eye].touches(&place.grown);
        here.map(|(_, leaf)| *leaf).filter(touches)
    }
}

/// The number of buckets along a side of a block.
const BLOCK: usize = 4;

/// A bucket among those of the frame.
#[derive(Clone, Copy, Debug)]
pub(super) struct Place {
    /// Its pixels, and those around it that the filters need.
    grown: PixelRect,
    /// Its column and row.
    cell: [usize; 2],
    /// The block that it belongs to.
    block: u32,
}

/// A grid that is shaded for its first use and dropped after its last one.
pub(super) struct LeafSlot {
    /// For each eye: the pixels in which it may be visible.
    pub(super) seen: Box<[Sighting]>,
    state: Mutex<LeafState>,
    /// The number of buckets, summed over all eyes, that have not released it.
    uses: AtomicU32,
    /// True when buckets may be rendered again. A dropped grid is then made again.
    again: bool,
    /// A hash of the splits that led to it.
    pub(super) path: u64,
    /// For each eye: the buckets that the grid touches, once it is made. Its bound may touch many more.
    touched: Box<[Touched]>,
    /// The number of these buckets, summed over all eyes, that have not released it.
    needs: AtomicU32,
}

/// The columns and rows of buckets that a grid touches, in one number: the first and the last one of each, in 16 bits.
/// It is [`Touched::UNKNOWN`] before the grid is made, and where the image has more buckets.
struct Touched(AtomicU64);

impl Touched {
    const UNKNOWN: u64 = u64::MAX;

    /// Stores a range of columns and one of rows.
    fn set(&self, [columns, rows]: &[std::ops::Range<usize>; 2]) {
        // An empty range ends before it begins.
        let ends = match columns.is_empty() || rows.is_empty() {
            true => [1, 0, 1, 0],
            false => [columns.start, columns.end - 1, rows.start, rows.end - 1],
        };
        if ends.iter().all(|end| *end < usize::from(u16::MAX)) {
            let packed = ends.iter().rev().fold(0, |all, end| all << 16 | *end as u64);
            self.0.store(packed, Ordering::Release);
        }
    }

    /// True when a bucket is touched; `None` when that is not known.
    fn has(&self, cell: [usize; 2]) -> Option<bool> {
        let packed = self.0.load(Ordering::Acquire);
        let end = |k: u32| (packed >> (16 * k) & 0xffff) as usize;
        (packed != Self::UNKNOWN)
            .then(|| (end(0)..=end(1)).contains(&cell[0]) && (end(2)..=end(3)).contains(&cell[1]))
    }
}

pub(super) enum LeafState {
    /// The grid is not diced.
    Waiting(Leaf),
    /// The grid is diced and shaded; `None` when nothing of it is visible. The leaf is kept when it may be needed
    /// again.
    Ready(Option<MadeGrid>, Option<Leaf>),
    /// All buckets have released it.
    Gone,
}

impl LeafState {
    /// Returns the leaf that must be diced and shaded; `None` when that was done.
    pub(super) fn leaf(&self) -> Option<&Leaf> {
        match self {
            Self::Waiting(leaf) => Some(leaf),
            _ => None,
        }
    }

    /// Returns the grid when it was made and is visible.
    pub(super) fn grid(&self) -> Option<(Arc<ShadedGrid>, Option<GridId>)> {
        match self {
            Self::Ready(Some(made), _) => Some((made.grid.clone(), made.kept)),
            _ => None,
        }
    }
}

impl LeafSlot {
    /// Locks the state. Other threads wait.
    pub(super) fn lock(&self) -> MutexGuard<'_, LeafState> {
        self.state.lock()
    }

    /// Locks the state to make the grid before it is requested. Returns `None` when it was made or another thread holds
    /// the lock. Never waits.
    pub(super) fn lock_early(&self) -> Option<MutexGuard<'_, LeafState>> {
        let state = self.state.try_lock()?;
        state.leaf().is_some().then_some(state)
    }

    /// Stores the grid; `None` when nothing of it is visible.
    pub(super) fn keep(&self, state: &mut LeafState, grid: Option<MadeGrid>) {
        if let LeafState::Waiting(leaf) = std::mem::replace(state, LeafState::Gone) {
            *state = LeafState::Ready(grid, self.again.then_some(leaf));
        }
    }

    /// Stores the buckets that the grid touches, for each eye. `passed` is true for a bucket that has released all of
    /// its grids.
    pub(super) fn touch(
        &self,
        cells: &[[std::ops::Range<usize>; 2]],
        passed: &dyn Fn(usize, [usize; 2]) -> bool,
    ) {
        let mut needs = 0;
        for (eye, [columns, rows]) in cells.iter().enumerate() {
            let each = rows.clone().flat_map(|row| columns.clone().map(move |column| [column, row]));
            needs += each.filter(|cell| !passed(eye, *cell)).count();
        }
        self.needs.store(u32::try_from(needs).unwrap_or(u32::MAX), Ordering::Release);
        self.touched.iter().zip(cells).for_each(|(touched, cells)| touched.set(cells));
    }

    /// True when the grid is made and does not touch a bucket.
    pub(super) fn is_elsewhere(&self, eye: usize, place: &Place) -> bool {
        self.touched[eye].has(place.cell) == Some(false)
    }

    /// Releases the grid for one bucket of one eye. It is dropped after the last bucket that it touches.
    pub(super) fn release(&self, eye: usize, place: &Place) {
        if self.touched[eye].has(place.cell) == Some(true) {
            let one_less = |needs: u32| needs.checked_sub(1);
            let before = self.needs.fetch_update(Ordering::AcqRel, Ordering::Acquire, one_less).unwrap_or(0);
            if before == 1 {
                *self.lock() = LeafState::Gone;
            }
        }
        let one_less = |uses: u32| uses.checked_sub(1);
        let before = self.uses.fetch_update(Ordering::AcqRel, Ordering::Acquire, one_less).unwrap_or(0);
        debug_assert!(self.again || before > 0, "each bucket releases a grid once");
        if before <= 1 {
            let mut state = self.lock();
            *state = match std::mem::replace(&mut *state, LeafState::Gone) {
                LeafState::Ready(_, Some(leaf)) => LeafState::Waiting(leaf),
                LeafState::Waiting(leaf) if self.again => LeafState::Waiting(leaf),
                _ => LeafState::Gone,
            };
        }
    }
}

/// The bound of a primitive or a grid as seen by an eye.
#[derive(Clone, Copy, Debug)]
pub(super) struct Sighting {
    /// The pixels in which it may be visible, inside of the frame's region.
    pub(super) rect: PixelRect,
    /// The least depth in camera space.
    pub(super) z_min: f32,
    /// True when no part of it is nearer than `z_min`. For large surfaces close to the eye, rounding may exceed the
    /// margin of `z_min`.
    pub(super) is_nearest: bool,
    /// True when motion or the lens may blur it.
    pub(super) blurs: bool,
}

impl Sighting {
    /// True when it may be visible in some pixels.
    fn touches(&self, pixels: &PixelRect) -> bool {
        !self.rect.intersection(pixels).is_empty()
    }
}

/// The number of shares of a primitive for each thread that splits it.
const SHARES: usize = 32;

/// The splits that led to a piece.
#[derive(Clone, Copy)]
struct Path {
    /// Their number.
    depth: u32,
    /// A hash of their parts.
    hash: u64,
}

impl Path {
    /// Returns the path of a part of the piece.
    fn part(self, index: usize) -> Self {
        Self { depth: self.depth + 1, ..self.beside(index) }
    }

    /// Returns the path of one of several pieces.
    fn beside(self, index: usize) -> Self {
        let mut bytes = [0; 16];
        bytes[..8].copy_from_slice(&self.hash.to_le_bytes());
        bytes[8..].copy_from_slice(&(index as u64).to_le_bytes());
        Self { hash: hash::bytes64(&bytes), ..self }
    }
}

/// A leaf of a primitive, where the eyes may see it, and the hash of its path.
type Part = (Box<[Sighting]>, Leaf, u64);

/// A part of a primitive while it is split.
enum Node {
    /// A piece that must be split or diced, and the splits that led to it.
    Piece(Piece, Path),
    Leaf(Part),
}

impl<S: FrameShader> Frame<'_, S> {
    /// Builds a primitive and bounds it. Returns `None` when it is not visible.
    ///
    /// `measuring` is the state of the thread that measures displacements. It is made for the first measurement.
    pub(super) fn job<'t>(
        &'t self,
        number: usize,
        primitive: &Arc<Primitive>,
        measuring: &mut Option<S::Thread<'t>>,
    ) -> Option<Job<S::Object>> {
        let attributes = &primitive.attributes;
        let camera = self.options.camera;
        let shutter = if self.pattern.blur { camera.shutter } else { [camera.shutter[0]; 2] };
        let Some(alive) = camera.existence(primitive, shutter) else {
            add(&self.counters.primitives_off_screen, 1);
            return None;
        };
        let existence = (alive != shutter).then_some(alive);
        let keys: Vec<ShapeKey<'_>> =
            primitive.keys.iter().map(|k| ShapeKey { time: k.time, params: &k.params }).collect();
        let reporter = self.options.reporter;
        let name = attributes.name();
        let mut report = |severity: Severity, text: String| {
            let text = if name.is_empty() { text } else { format!("object \"{name}\": {text}") };
            reporter.once(&text.clone(), severity, &primitive.at, text);
        };
        let object = self.shader.object(primitive);
        let mut traits = self.traits_of(primitive, &object);
        let pieces = self.pieces_of(primitive, &keys, traits.preshaded, &mut report)?;
        let placement = self.placement_of(primitive, &pieces, alive);
        if let Some(what) = self.unplaceable(&pieces, &placement) {
            report(Severity::Error, format!("{} is left out: {what}", primitive.shape.call_name()));
            return None;
        }
        let quality = attributes.get(attr::SHADINGQUALITY);
        if quality > MAX_QUALITY && self.options.dicing_camera.preview == 0.0 {
            report(
                Severity::Warning,
                format!("\"shadingquality\" {quality:e} is more than {MAX_QUALITY}, which is used"),
            );
        }
        self.check_precision(primitive, &pieces, &placement);
        let later = match granita_geom::variables_move(&keys) && !traits.preshaded {
            true => later_times(&placement, &keys),
            false => Vec::new(),
        };
        traits.may_batch &= later.is_empty();
        let mut job = Job {
            number: u32::try_from(number).unwrap_or(u32::MAX),
            time: existence.map_or(self.options.dicing_camera.shading_time(), |[from, _]| from),
            later,
            existence,
            settings: DiceSettings::new(attributes, &self.dicing, self.options.dicing_camera),
            culls_hidden: attributes.get(attr::CULL_OCCLUSION),
            primitive: primitive.clone(),
            object,
            traits,
            placement,
            seen: Box::default(),
            budget: Budget::new(self.dicing.most_points()),
            pieces: Mutex::default(),
            split: OnceLock::new(),
            passed: Mutex::new(Some(Vec::new())),
        };
        if traits.measures {
            job.traits.max_displacement_world = self.measured_displacement(&job, &pieces, measuring);
        }
        job.seen = self.sightings_of_all(&job, &pieces);
        if job.seen.iter().all(|s| s.rect.is_empty()) {
            add(&self.counters.primitives_off_screen, 1);
            return None;
        }
        job.pieces = Mutex::new(pieces);
        Some(job)
    }

    /// Returns the traits of a primitive's object. They may depend on the primitive and on the frame too.
    pub(super) fn traits_of(&self, primitive: &Primitive, object: &S::Object) -> ObjectTraits {
        let mut traits = self.shader.traits(object);
        // A string that is a primitive variable may name a file that is saved to.
        let has_texts = |keys: &Params| keys.iter().any(|p| matches!(p.data, ParamData::String(_)));
        traits.saves |= self.options.dump.is_some() || primitive.keys.iter().any(|k| has_texts(&k.params));
        traits
    }

    /// Returns the pieces of a primitive; `None` (reported) when it cannot be built. The vertices of a `preshaded`
    /// grid are its points.
    fn pieces_of(
        &self,
        primitive: &Primitive,
        keys: &[ShapeKey<'_>],
        preshaded: bool,
        report: &mut dyn FnMut(Severity, String),
    ) -> Option<Vec<Piece>> {
        let built = match preshaded::lattice(primitive).filter(|_| preshaded) {
            Some(counts) => granita_geom::build_lattice(counts, keys, report),
            None => {
                let trim = trimming(&primitive.attributes, self.dicing.trim_quality);
                granita_geom::build(&primitive.shape, keys, trim, report)
            }
        };
        match built {
            Ok(pieces) => {
                add(&self.counters.primitives_built, 1);
                Some(pieces)
            }
            Err(error) => {
                report(Severity::Error, format!("{} is left out: {error}", primitive.shape.call_name()));
                None
            }
        }
    }

    /// Returns the placement of the pieces of a primitive that exists between the times `alive`.
    fn placement_of(&self, primitive: &Primitive, pieces: &[Piece], alive: [f32; 2]) -> Placement {
        let shape_times = pieces.first().map_or(&[][..], |p| p.key_times());
        // The eyes move with their camera.
        let cameras = [&self.options.camera.world_to_camera, &self.options.dicing_camera.world_to_camera];
        let mut placement = Placement::new(&primitive.attributes.to_world, shape_times, &cameras, alive);
        let eyes = self.eyes.iter().map(|eye| eye.camera).chain([self.options.dicing_camera]);
        placement.look_from(eyes, largest_coordinates(pieces.iter().map(|p| &**p)));
        placement
    }

    /// Warns when an object lies so far from the origin that the rounding of its points is visible.
    fn check_precision(&self, primitive: &Primitive, pieces: &[Piece], placement: &Placement) {
        let time = placement.times()[0];
        let camera = self.eyes[0].camera;
        let object =
            pieces.iter().map(|p| Placement::object_bound(&**p, time)).fold(Bound::EMPTY, Bound::union);
        let middle = placement.to_world.at(time).point((object.min + object.max) * 0.5);
        let z = camera.world_to_camera.at(time).point(middle).z;
        let distance = middle.abs().max_element();
        let step = distance * f32::EPSILON;
        let step_px = (camera.raster_scale(z) * step).abs().max_element();
        // An object as large as its distance from the origin has no detail that would be lost.
        let world = object.transformed(&placement.to_world.at(time));
        let coarse = step > 1e-3 * (world.max - world.min).length();
        if coarse && z > camera.near && step_px > 1.0 && step_px.is_finite() {
            let name = primitive.attributes.name();
            self.options.reporter.once(
                "far from the origin",
                Severity::Warning,
                &primitive.at,
                format!(
                    "object \"{name}\": it lies {distance:e} from the origin of the world, where numbers are {step} apart, \
                     {step_px:.0} pixels as camera \"{}\" sees it; move the scene closer to the origin",
                    camera.name
                ),
            );
        }
    }

    /// Returns the number of a block of buckets, by its column and row.
    fn block(&self, [column, row]: [usize; 2]) -> u32 {
        let (_, columns) = self.buckets.rows();
        u32::try_from(row * columns.div_ceil(BLOCK) + column).unwrap_or(u32::MAX)
    }

    /// Returns the place of a bucket.
    pub(super) fn place(&self, bucket: u32) -> Place {
        let cell = self.buckets.cell(bucket as usize);
        let grown = self.buckets.order[bucket as usize].grown(self.margin);
        Place { grown, cell, block: self.block(cell.map(|at| at / BLOCK)) }
    }

    /// Returns the grids of a primitive, which is split for the first bucket that requests them.
    pub(super) fn split<'j>(&self, job: &'j Job<S::Object>) -> &'j Split {
        job.split.get_or_init(|| {
            add(&self.counters.primitives_split, 1);
            let pieces = std::mem::take(&mut *job.pieces.lock());
            let parts = self.leaves(job, pieces);
            let parts = if job.budget.is_spent() { self.leave_out(&job.primitive, parts) } else { parts };
            let mut leaves = Vec::with_capacity(parts.len());
            let mut of_block = vec![Vec::with_capacity(parts.len()); self.eyes.len()];
            for (seen, leaf, path) in parts {
                let Ok(index) = u32::try_from(leaves.len()) else { break };
                let mut uses = 0;
                for (of_block, seen) in of_block.iter_mut().zip(&seen) {
                    let cells = self.buckets.cells(&seen.rect.grown(self.margin));
                    let count = cells[0].len() * cells[1].len();
                    if seen.rect.is_empty() || count == 0 {
                        continue;
                    }
                    uses += u32::try_from(count).unwrap_or(u32::MAX);
                    let [columns, rows] = cells.map(|span| span.start / BLOCK..=(span.end - 1) / BLOCK);
                    for row in rows {
                        of_block.extend(columns.clone().map(|column| (self.block([column, row]), index)));
                    }
                }
                let touched = seen.iter().map(|_| Touched(AtomicU64::new(Touched::UNKNOWN))).collect();
                leaves.push(LeafSlot {
                    seen,
                    touched,
                    needs: AtomicU32::new(0),
                    state: Mutex::new(LeafState::Waiting(leaf)),
                    uses: AtomicU32::new(uses),
                    again: self.again,
                    path,
                });
            }
            add(&self.counters.grids, leaves.len());
            of_block.iter_mut().for_each(|list| list.sort_unstable());
            let split = Split { leaves, of_block };
            let passed = job.passed.lock().take();
            passed.into_iter().flatten().for_each(|(eye, bucket)| split.release(eye, &self.place(bucket)));
            split
        })
    }

    /// Splits pieces into leaves, in the order of the surface. Large primitives are split by all threads, because other
    /// threads may wait for them.
    fn leaves(&self, job: &Job<S::Object>, pieces: Vec<Piece>) -> Vec<Part> {
        let threads = self.options.threads;
        let enough = SHARES * threads;
        let root = Path { depth: 0, hash: 0 };
        let pieces = pieces.into_iter().enumerate();
        let mut nodes: Vec<Node> = pieces.map(|(k, piece)| Node::Piece(piece, root.beside(k))).collect();
        let open = |nodes: &[Node]| nodes.iter().filter(|node| matches!(node, Node::Piece(..))).count();
        while threads > 1 && (1..enough).contains(&open(&nodes)) {
            let mut next = Vec::with_capacity(2 * nodes.len());
            for node in nodes {
                match node {
                    Node::Piece(piece, path) => self.step(job, piece, path, &mut next),
                    leaf => next.push(leaf),
                }
            }
            nodes = next;
        }
        let finish = |nodes: Vec<Node>| {
            let mut leaves = Vec::new();
            let mut stack: Vec<Node> = nodes.into_iter().rev().collect();
            while let Some(node) = stack.pop() {
                match node {
                    Node::Leaf(part) => leaves.push(part),
                    Node::Piece(piece, path) => {
                        // The first part must be popped first.
                        let parts = stack.len();
                        self.step(job, piece, path, &mut stack);
                        stack[parts..].reverse();
                    }
                }
            }
            leaves
        };
        if threads == 1 || open(&nodes) == 0 {
            return finish(nodes);
        }
        let share = nodes.len().div_ceil(enough);
        let mut shares: Vec<Vec<Node>> = Vec::with_capacity(enough);
        let mut nodes = nodes.into_iter();
        while nodes.len() > 0 {
            shares.push(nodes.by_ref().take(share).collect());
        }
        let done = parallel_map(shares, threads, || (), |(), nodes| finish(nodes));
        done.into_iter().flatten().collect()
    }

    /// Splits or dices a piece. Appends its parts, or itself as a leaf, or nothing when it is not visible.
    fn step(&self, job: &Job<S::Object>, piece: Piece, path: Path, out: &mut Vec<Node>) {
        if job.budget.is_spent() {
            return;
        }
        let seen = self.sightings(job, &*piece, &self.region);
        if seen.iter().all(|s| s.rect.is_empty()) {
            add(&self.counters.pieces_culled, 1);
            return;
        }
        match self.plan(job, &*piece, path.depth) {
            Plan::Split(direction, settled) => {
                // The number of groups is bounded by the number of parts in the scene.
                job.budget.spend(if piece.is_group() { 0 } else { POINTS_OF_A_SPLIT });
                let parts = piece.split_settled(direction, settled);
                out.extend(parts.into_iter().enumerate().map(|(k, part)| Node::Piece(part, path.part(k))));
            }
            Plan::Dice(rates) => {
                job.budget.spend((rates.nu * rates.nv) as u64);
                out.push(Node::Leaf((seen, Leaf { piece, rates: Box::new(rates) }, path.hash)));
            }
        }
    }

    /// Determines whether a piece that results from `depth` splits is diced, or how it is split.
    pub(super) fn plan(&self, job: &Job<S::Object>, piece: &dyn Surface, depth: u32) -> Plan {
        match piece.lattice() {
            Some([nu, nv]) if nu * nv <= MOST_POINTS => Plan::Dice(Rates { nu, nv, ..Rates::default() }),
            Some([nu, nv]) if nu > nv => Plan::Split(SplitDirection::U, [None; 4]),
            Some(_) => Plan::Split(SplitDirection::V, [None; 4]),
            None => self.measure.plan(piece, &job.placement, &job.settings, depth),
        }
    }

    /// Releases a primitive in a bucket for an eye that does not need it. A primitive that is only released is never
    /// split.
    pub(super) fn pass(&self, job: &Job<S::Object>, eye: usize, bucket: u32) {
        if let Some(passed) = &mut *job.passed.lock() {
            passed.push((eye, bucket));
            return;
        }
        self.split(job).release(eye, &self.place(bucket));
    }
}

/// Returns the times after the first one between which the primitive variables of a primitive change linearly.
fn later_times(placement: &Placement, keys: &[ShapeKey<'_>]) -> Vec<f32> {
    let [first, .., last] = *placement.times() else { return Vec::new() };
    let inner = keys.iter().map(|key| key.time).filter(|t| (first..last).contains(t) && *t > first);
    inner.chain([last]).collect()
}
