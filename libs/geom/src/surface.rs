//! The face every primitive shows to the renderer.

use crate::dice::{Dice, View};
use crate::side::{SidePart, SidePoints};
use granita_base::{Bound, DVec3, Vec3};

/// A piece of a primitive.
pub type Piece = Box<dyn Surface>;

/// Along which parameter a piece is cut.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SplitDirection {
    /// The children meet at a line of constant u.
    U,
    /// The children meet at a line of constant v.
    V,
}

/// A piece of a primitive that can be bounded, split and diced. All in object space.
pub trait Surface: Send + Sync {
    /// Times of the motion keys: one or more, increasing.
    fn key_times(&self) -> &[f32];

    /// The motion key at which the primitive is to be measured for dicing, where it may be far smaller at the others; `None`
    /// for the first moment that is shown.
    fn measured_key(&self) -> Option<usize> {
        None
    }

    /// A box that holds the piece at motion key `key`, widths of points and curves included (those given in object
    /// space; for the others see [`Surface::raster_width`]).
    fn bound(&self, key: usize) -> Bound;

    /// Replaces `out` by `nu x nv` positions (u fastest) spread evenly over the piece at motion key `key`, to
    /// estimate dicing rates. Points and curves face along z; see [`Surface::positions_towards`].
    fn positions(&self, key: usize, nu: usize, nv: usize, out: &mut Vec<Vec3>);

    /// As [`Surface::positions`], with points and curves turned towards the viewer. `view` gets the motion key and
    /// a position.
    fn positions_towards(
        &self,
        key: usize,
        nu: usize,
        nv: usize,
        view: &dyn Fn(usize, Vec3) -> View,
        out: &mut Vec<Vec3>,
    ) {
        let _ = view;
        self.positions(key, nu, nv, out);
    }

    /// Replaces `out` by points whose convex hull holds the piece at motion key `key`, in double precision. All keys give
    /// equally many, and those between two keys are blended point by point.
    fn hull(&self, key: usize, out: &mut Vec<DVec3>) {
        out.clear();
        out.extend(self.bound(key).corners().map(|p| p.as_dvec3()));
    }

    /// As [`Surface::positions`], in double precision: for pieces whose coordinates are large beside their distance
    /// from the viewer. Rounded to single precision these are the same.
    fn precise_positions(&self, key: usize, nu: usize, nv: usize, out: &mut Vec<DVec3>) {
        let mut rounded = Vec::new();
        self.positions(key, nu, nv, &mut rounded);
        out.clear();
        out.extend(rounded.iter().map(|p| p.as_dvec3()));
    }

    /// `[u0, u1, v0, v1]`: the range of the primitive's (for meshes: the face's) parameters that the piece covers.
    /// For pieces of several faces, curves or points: of one of them.
    fn domain(&self) -> [f32; 4];

    /// Whether [`Surface::split`] gives smaller pieces. Pieces cease to be splittable when their parameters no
    /// longer divide.
    fn is_splittable(&self) -> bool {
        true
    }

    /// Whether the piece spans several spline segments, faces, curves or particles, so that it must be split before
    /// it can be diced.
    fn must_split(&self) -> bool {
        false
    }

    /// Whether the piece is several faces, curves or particles: it must be split, and in no direction.
    fn is_group(&self) -> bool {
        false
    }

    /// The piece in two or more parts that together cover it. A group ignores `direction`. Empty when the piece is not splittable.
    fn split(&self, direction: SplitDirection) -> Vec<Piece>;

    /// As [`Surface::split`], with the number of equal steps of each side (numbered as in [`Surface::side`]) that is not to
    /// be halved any more: where the halves have parts of it, they share these steps.
    fn split_settled(&self, direction: SplitDirection, steps: [Option<u32>; 4]) -> Vec<Piece> {
        let _ = steps;
        self.split(direction)
    }

    /// A side of the piece as neighbours share it: 0 at the start of v and 1 at its end (both run along u), 2 at the start
    /// of u and 3 at its end. `None` for sides that are settled, pieces of several faces, and primitives whose
    /// pieces do not meet at points (points, curves).
    fn side(&self, side: usize) -> Option<SidePart> {
        let _ = side;
        None
    }

    /// How many steps a settled side has; `None` for others.
    fn settled_steps(&self, side: usize) -> Option<usize> {
        let _ = side;
        None
    }

    /// Replaces `out` by `n` positions (at least 2) spread evenly over a part of a side at motion key `key`. They are those of
    /// whoever shares the edge, to the bit.
    fn side_positions(&self, key: usize, part: &SidePart, n: usize, out: &mut Vec<Vec3>) {
        let _ = (key, part, n);
        out.clear();
    }

    /// As [`Surface::side_positions`], in double precision.
    fn precise_side_positions(&self, key: usize, part: &SidePart, n: usize, out: &mut Vec<DVec3>) {
        let mut rounded = Vec::new();
        self.side_positions(key, part, n, &mut rounded);
        out.clear();
        out.extend(rounded.iter().map(|p| p.as_dvec3()));
    }

    /// The positions of [`Surface::dice_between`] at motion key `key` in double precision; `None` for primitives that have
    /// no more than single precision.
    fn precise_between(&self, key: usize, size: [usize; 2], sides: &[SidePoints; 4]) -> Option<Vec<DVec3>> {
        let _ = (key, size, sides);
        None
    }

    /// As [`Surface::dice`], with the points on each side where `sides` says. Where the lattice has more points than the
    /// side, neighbouring points of it are the same.
    fn dice_between(&self, nu: usize, nv: usize, sides: &[SidePoints; 4]) -> Dice {
        let _ = sides;
        self.dice(nu, nv)
    }

    /// Evaluates `nu x nv` points (at least 2 each, u fastest), the first and last in each direction on the edges of
    /// the piece. A piece that must be split dices its first part only.
    fn dice(&self, nu: usize, nv: usize) -> Dice;

    /// How many facets the piece spans: quadrilaterals, or triangles of which two corners are the same, of a mesh of flat
    /// faces. 0 for other primitives.
    fn facets(&self) -> usize {
        0
    }

    /// Positions of the corners (0,0), (1,0), (0,1) and (1,1) of a facet at motion key `key`: to the bit what dicing it
    /// gives. Zeros for a facet that does not exist.
    fn facet(&self, facet: usize, key: usize) -> [Vec3; 4] {
        let _ = (facet, key);
        [Vec3::ZERO; 4]
    }

    /// A facet as a piece of its own; `None` for one that does not exist.
    fn facet_piece(&self, facet: usize) -> Option<Piece> {
        let _ = facet;
        None
    }

    /// Whether the piece turns towards the viewer ([`Dice::turn`]).
    fn is_facing(&self) -> bool {
        false
    }

    /// Whether the piece is of a curve: u runs across it, v along.
    fn is_curve(&self) -> bool {
        false
    }

    /// Whether the piece may be diced over a crease: a place inside of it where its spline bends at an angle.
    /// Splitting it along V until none is left puts every crease on an edge. Only curves are diced over creases;
    /// pieces of other primitives always end there.
    fn has_crease(&self) -> bool {
        false
    }

    /// The points along u and v of a piece that can only be diced into those ([`crate::build_lattice`]).
    fn lattice(&self) -> Option<[usize; 2]> {
        None
    }

    /// Largest width in pixels among widths given in pixels ("rasterwidth" of points); 0 without. The bound of the
    /// piece on the screen grows by half of it.
    fn raster_width(&self) -> f32 {
        0.0
    }
}
