//! The interface of every primitive to the renderer.

use crate::dice::{Dice, View};
use crate::side::{SidePart, SidePoints};
use granita_base::{Bound, DVec3, Vec3};

/// A piece of a primitive.
pub type Piece = Box<dyn Surface>;

/// The parameter along which a piece is split.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SplitDirection {
    /// The children share a line of constant u.
    U,
    /// The children share a line of constant v.
    V,
}

/// A piece of a primitive that can be bounded, split and diced. Everything is in object space.
pub trait Surface: Send + Sync {
    /// Returns the times of the motion keys: one or more, increasing.
    fn key_times(&self) -> &[f32];

    /// Returns the motion key at which the primitive is measured for dicing, when it may be far smaller at the
    /// others. `None` for the first visible moment.
    fn measured_key(&self) -> Option<usize> {
        None
    }

    /// Returns a box that contains the piece at motion key `key`. Widths of points and curves are included when they
    /// are given in object space; for the others see [`Surface::raster_width`].
    fn bound(&self, key: usize) -> Bound;

    /// Replaces `out` by `nu x nv` positions (u fastest), spread evenly over the piece at motion key `key`, from
    /// which dicing rates are estimated. Points and curves face along z; see [`Surface::positions_towards`].
    fn positions(&self, key: usize, nu: usize, nv: usize, out: &mut Vec<Vec3>);

    /// Does the same as [`Surface::positions`], with points and curves turned towards the viewer. `view` receives the
    /// motion key and a position.
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

    /// Replaces `out` by points whose convex hull contains the piece at motion key `key`, in double precision. All
    /// keys give the same number of points. Between two keys the points are interpolated one by one.
    fn hull(&self, key: usize, out: &mut Vec<DVec3>) {
        out.clear();
        out.extend(self.bound(key).corners().map(|p| p.as_dvec3()));
    }

    /// Does the same as [`Surface::positions`] in double precision, for pieces whose coordinates are large relative
    /// to their distance from the viewer. Rounded to single precision the positions are the same.
    fn precise_positions(&self, key: usize, nu: usize, nv: usize, out: &mut Vec<DVec3>) {
        let mut rounded = Vec::new();
        self.positions(key, nu, nv, &mut rounded);
        out.clear();
        out.extend(rounded.iter().map(|p| p.as_dvec3()));
    }

    /// Returns `[u0, u1, v0, v1]`, the range of the primitive's (for meshes: the face's) parameters that the piece
    /// covers. For a piece of several faces, curves or points it is the range of one of them.
    fn domain(&self) -> [f32; 4];

    /// True when [`Surface::split`] gives smaller pieces. Pieces are not splittable when their parameters can no
    /// longer be divided.
    fn is_splittable(&self) -> bool {
        true
    }

    /// True when the piece spans several spline segments, faces, curves or particles, so that it must be split before
    /// it can be diced.
    fn must_split(&self) -> bool {
        false
    }

    /// True when the piece is several faces, curves or particles. It must then be split, and the direction is
    /// ignored.
    fn is_group(&self) -> bool {
        false
    }

    /// Splits the piece into two or more parts that together cover it. A group ignores `direction`. Returns no parts
    /// when the piece is not splittable.
    fn split(&self, direction: SplitDirection) -> Vec<Piece>;

    /// Does the same as [`Surface::split`], with the number of equal steps of each side (numbered as in
    /// [`Surface::side`]) that is not halved any further. Parts that contain a fraction of such a side
    /// share its steps.
    fn split_settled(&self, direction: SplitDirection, steps: [Option<u32>; 4]) -> Vec<Piece> {
        let _ = steps;
        self.split(direction)
    }

    /// Returns a side of the piece as neighbours share it: 0 at the start of v and 1 at its end (both run along u), 2
    /// at the start of u and 3 at its end. `None` for settled sides, for pieces of several faces, and for primitives
    /// whose pieces do not share points (points, curves).
    fn side(&self, side: usize) -> Option<SidePart> {
        let _ = side;
        None
    }

    /// Returns the number of steps of a settled side; `None` for others.
    fn settled_steps(&self, side: usize) -> Option<usize> {
        let _ = side;
        None
    }

    /// Replaces `out` by `n` positions (at least 2) spread evenly over a part of a side at motion key `key`. They are
    /// the same to the bit for every piece that shares the edge.
    fn side_positions(&self, key: usize, part: &SidePart, n: usize, out: &mut Vec<Vec3>) {
        let _ = (key, part, n);
        out.clear();
    }

    /// Does the same as [`Surface::side_positions`] in double precision.
    fn precise_side_positions(&self, key: usize, part: &SidePart, n: usize, out: &mut Vec<DVec3>) {
        let mut rounded = Vec::new();
        self.side_positions(key, part, n, &mut rounded);
        out.clear();
        out.extend(rounded.iter().map(|p| p.as_dvec3()));
    }

    /// Returns the positions of [`Surface::dice_between`] at motion key `key` in double precision; `None` for
    /// primitives that have only single precision.
    fn precise_between(&self, key: usize, size: [usize; 2], sides: &[SidePoints; 4]) -> Option<Vec<DVec3>> {
        let _ = (key, size, sides);
        None
    }

    /// Does the same as [`Surface::dice`], with the points on each side at the places of `sides`. Where the lattice
    /// has more points than the side, neighbouring points of the lattice coincide.
    fn dice_between(&self, nu: usize, nv: usize, sides: &[SidePoints; 4]) -> Dice {
        let _ = sides;
        self.dice(nu, nv)
    }

    /// Evaluates `nu x nv` points (at least 2 each, u fastest). The first and last in each direction are on the edges
    /// of the piece. A piece that must be split dices its first part only.
    fn dice(&self, nu: usize, nv: usize) -> Dice;

    /// Does the same as [`Surface::dice_between`], with points and curves turned towards the viewer. See
    /// [`Dice::turn`].
    fn dice_towards(
        &self,
        nu: usize,
        nv: usize,
        sides: &[SidePoints; 4],
        view: &dyn Fn(usize, Vec3) -> View,
    ) -> Dice {
        let mut dice = self.dice_between(nu, nv, sides);
        dice.turn(view);
        dice
    }

    /// The number of facets that the piece spans, for a mesh of flat faces. A facet is a quadrilateral, or a triangle
    /// of which two corners are the same. 0 for other primitives.
    fn facets(&self) -> usize {
        0
    }

    /// Returns the positions of the corners (0,0), (1,0), (0,1) and (1,1) of a facet at motion key `key`. They are
    /// the same to the bit as the result of dicing. Zeros for a facet that does not exist.
    fn facet(&self, facet: usize, key: usize) -> [Vec3; 4] {
        let _ = (facet, key);
        [Vec3::ZERO; 4]
    }

    /// Returns a facet as a piece of its own; `None` for one that does not exist.
    fn facet_piece(&self, facet: usize) -> Option<Piece> {
        let _ = facet;
        None
    }

    /// True when the piece turns towards the viewer ([`Dice::turn`]).
    fn is_facing(&self) -> bool {
        false
    }

    /// True when the piece belongs to a curve. u then runs across the curve and v along it.
    fn is_curve(&self) -> bool {
        false
    }

    /// True when dicing the piece may cross a crease, which is a place inside of it where its spline bends at an
    /// angle. Splitting it along V until there are no such pieces puts every crease on an edge. Only curves are diced
    /// over creases. Pieces of other primitives always end there.
    fn has_crease(&self) -> bool {
        false
    }

    /// Returns the numbers of points along u and v of a piece that can only be diced into these points
    /// ([`crate::build_lattice`]).
    fn lattice(&self) -> Option<[usize; 2]> {
        None
    }

    /// Returns the largest width in pixels among widths that are given in pixels ("rasterwidth" of points); 0
    /// without. The bound of the piece in raster space grows by half of it.
    fn raster_width(&self) -> f32 {
        0.0
    }
}
