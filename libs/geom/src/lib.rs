//! Primitives that can be bounded, split and diced.
//!
//! [`build`] turns the description of a primitive ([`granita_base::ShapeDesc`], one [`ShapeKey`] for each motion key)
//! into [`Piece`]s. A piece has a bound, can be split into smaller pieces, and can be diced into a lattice of points
//! ([`Dice`]). This crate does not depend on shaders or cameras. Dicing rates are passed as numbers, and everything
//! is in object space.
//!
//! # Invariants
//!
//! - **Splitting does not move the surface.** Pieces share the control vertices of their primitive and differ only in
//!   the range of parameters that they cover. A point is evaluated by the same arithmetic in every piece.
//! - **Edges agree to the bit.** Two pieces that share an edge and are diced at rates that put points at the same
//!   places of it have identical positions there, also when they run along the edge in opposite directions. This
//!   holds between the pieces of a patch, the faces of a mesh, and patches with equal outer Bezier vertices.
//! - **Borders can be made to agree** at any rates. [`Surface::dice_between`] puts the points on each side of a
//!   lattice at the places that the side determines, not the lattice.
//! - **Bounds hold.** They come from convex hulls of control vertices (analytically for spheres), with the widths of
//!   points and curves included.
//! - **Orientation.** `dpdu x dpdv` of a mesh points along the Newell normal of its winding, and of a whole sphere
//!   outward. Callers decide whether to flip it.
//! - **Points and curves face the viewer**, which is not part of this crate: see [`Facing`] and [`Dice::turn`].
//!
//! # Deliberately absent
//!
//! Dicing rates, displacement, shading normals of surfaces without a user normal, transformation to other spaces.
//!
//! # Example
//!
//! ```
//! use granita_base::{Params, ShapeDesc};
//! let shape = ShapeDesc::Sphere { radius: 1.0, zmin: -1.0, zmax: 1.0, thetamax_deg: 360.0 };
//! let params = Params::new();
//! let keys = [granita_geom::ShapeKey { time: 0.0, params: &params }];
//! let pieces = granita_geom::build(&shape, &keys, None, &mut |_, _| {}).unwrap();
//! let dice = pieces[0].dice(9, 5);
//! assert!(dice.p[0].iter().all(|p| (p.length() - 1.0).abs() < 1e-6));
//! ```
#![forbid(unsafe_code)]

mod bezier;
mod build;
mod cage;
mod curve;
mod curves;
mod dice;
mod error;
mod key;
mod lattice;
mod mesh;
mod moving;
mod net;
mod order;
mod patch;
mod points;
mod polygon;
mod range;
mod side;
mod sphere;
mod spline;
mod subdiv;
mod surface;
mod sweep;
mod trim;
mod vars;
mod width;

pub use build::build;
pub use dice::{Dice, DiceData, DicePrimvar, Facing, View};
pub use error::GeomError;
pub use key::ShapeKey;
pub use lattice::build_lattice;
pub use moving::variables_move;
pub use side::{SidePart, SidePoints};
pub use surface::{Piece, SplitDirection, Surface};
pub use trim::{TrimMask, Trimming};
