//! Writes shaded grids as a scene (reference 4.3.7, "griddump:filename").
//!
//! Every grid that a bucket requests becomes a linear `Patch` in "camera" space. It has the colour, the opacity and the
//! variables that the images of the frame request at each of its points, and stands in a `Motion` block when it moves.
//! A trimmed grid becomes several patches, which cover its remaining micropolygons.
//!
//! Threads shade grids in any order. The text of each grid is appended to a nameless file. When the frame is complete,
//! the texts are copied in the order of the scene. Memory holds their offsets only, the file has the same bytes for any
//! number of threads, and an incomplete file never appears.

use crate::{CallText, CameraView, RenderError, preshaded};
use granita_base::{
    BaseType, Color, CurveBasis, Files, Interp, Param, ParamData, ParamType, Params, ShapeDesc, Transform,
    Vec3,
};
use granita_gsl::ir::ValueType;
use granita_hider::ShadedGrid;
use granita_scene::{Call, Holdout};
use parking_lot::Mutex;
use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// A dump that is being made. The threads of a frame share it.
pub(crate) struct GridDump {
    path: PathBuf,
    files: Files,
    binary: bool,
    text: CallText,
    /// The first camera of the scene, whose space is "camera".
    camera: CameraView,
    spill: Mutex<Spill>,
}

/// The texts of grids in the order of their shading.
struct Spill {
    file: File,
    /// The number of bytes written.
    length: u64,
    pieces: Vec<Piece>,
    /// The first error.
    failed: Option<io::Error>,
}

/// The place of the text of a grid. The order of fields determines the sorting.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct Piece {
    /// The index of the primitive, and of the grid in it.
    order: (usize, u32),
    from: u64,
    length: u64,
}

/// The description of a grid, besides its points and colours.
pub(crate) struct Described<'a> {
    /// The index of the primitive, and of the grid in it, which determine its place in the file.
    pub(crate) order: (usize, u32),
    /// The name of the object.
    pub(crate) name: Arc<str>,
    /// The names and types of the variables of the grid's [`Shade`](granita_hider::Shade).
    pub(crate) variables: &'a [(Arc<str>, ValueType)],
    /// The camera of the grid's first view.
    pub(crate) eye: &'a CameraView,
}

impl GridDump {
    /// Begins the file `path`, in the space of the scene's first camera.
    ///
    /// # Errors
    /// Returns [`RenderError::Io`] when the nameless file cannot be made.
    pub(crate) fn new(
        path: &Path,
        files: &Files,
        binary: bool,
        text: CallText,
        camera: &CameraView,
    ) -> Result<Self, RenderError> {
        // The nameless file is on the disk of the final one. A pipe has no such place.
        let file = files.scratch(path).map_err(|source| RenderError::Io { path: path.to_owned(), source })?;
        let spill = Mutex::new(Spill { file, length: 0, pieces: Vec::new(), failed: None });
        Ok(Self { path: path.to_owned(), files: files.clone(), binary, text, camera: camera.clone(), spill })
    }

    /// Appends a grid.
    pub(crate) fn add(&self, grid: &ShadedGrid, described: &Described<'_>) {
        let bytes = (self.text)(calls(grid, described, &self.camera), self.binary);
        let mut spill = self.spill.lock();
        if spill.failed.is_some() {
            return;
        }
        let written = bytes.and_then(|bytes| spill.file.write_all(&bytes).map(|()| bytes.len() as u64));
        match written {
            Ok(length) => {
                let from = spill.length;
                spill.length += length;
                spill.pieces.push(Piece { order: described.order, from, length });
            }
            Err(error) => spill.failed = Some(error),
        }
    }

    /// Writes the file. A dump that is dropped leaves no file.
    ///
    /// # Errors
    /// Returns [`RenderError::Io`] when this or an earlier write failed.
    pub(crate) fn finish(self) -> Result<(), RenderError> {
        let Self { path, files, binary, text, camera, spill } = self;
        let mut spill = spill.into_inner();
        let io = |source| RenderError::Io { path: path.clone(), source };
        if let Some(error) = spill.failed.take() {
            return Err(io(error));
        }
        spill.pieces.sort_unstable();
        let head = format!("Shaded grids in the space of camera \"{}\"", camera.name);
        let mut file = files.create(&path)?;
        file.write_all(&text(vec![Call::Comment(head.into())], binary).map_err(io)?).map_err(io)?;
        let mut bytes = Vec::new();
        for piece in &spill.pieces {
            bytes.resize(usize::try_from(piece.length).unwrap_or(usize::MAX), 0);
            spill.file.seek(SeekFrom::Start(piece.from)).map_err(io)?;
            spill.file.read_exact(&mut bytes).map_err(io)?;
            file.write_all(&bytes).map_err(io)?;
        }
        Ok(file.commit()?)
    }
}

/// Returns the calls that describe a grid, in the space of a camera.
fn calls(grid: &ShadedGrid, described: &Described<'_>, camera: &CameraView) -> Vec<Call> {
    let mut calls = Vec::new();
    let mut attributes = Vec::new();
    if !described.name.is_empty() {
        attributes.push(param("string name", &*described.name));
    }
    if grid.holdout != Holdout::None {
        attributes.push(param("int holdout", if grid.holdout == Holdout::Matte { 1 } else { 2 }));
    }
    let own = !attributes.is_empty();
    if own {
        calls.push(Call::PushAttributes);
        calls.extend(attributes.into_iter().map(Call::Attribute));
    }
    let points = positions(grid, described.eye, camera);
    let variables = variables(grid, described.variables, camera);
    for part in parts(grid, &points) {
        if points.len() > 1 {
            calls.push(Call::Motion(grid.views[0].times.as_slice().into()));
        }
        for p in &points {
            calls.push(patch(grid, &part, p, &variables));
        }
    }
    if own {
        calls.push(Call::PopAttributes);
    }
    calls
}

/// Returns the points at each time in the space of a camera. The first view of the grid is the view of `eye`.
fn positions(grid: &ShadedGrid, eye: &CameraView, camera: &CameraView) -> Vec<Vec<Vec3>> {
    let view = &grid.views[0];
    if eye.world_to_camera == camera.world_to_camera {
        return view.p_cam.clone();
    }
    let moved = |(time, p): (&f32, &Vec<Vec3>)| {
        let to_camera = eye.world_to_camera.at(*time).inverse().then(&camera.world_to_camera.at(*time));
        p.iter().map(|p| to_camera.point(*p)).collect()
    };
    view.times.iter().zip(&view.p_cam).map(moved).collect()
}

/// The values of a variable at every point, component by component, in the space of a camera.
struct Variable<'a> {
    name: &'a Arc<str>,
    base: BaseType,
    width: usize,
    values: Vec<f32>,
}

/// Returns the variables that are not part of every patch.
fn variables<'a>(
    grid: &ShadedGrid,
    wanted: &'a [(Arc<str>, ValueType)],
    camera: &CameraView,
) -> Vec<Variable<'a>> {
    let n = grid.nu * grid.nv;
    let to_camera = camera.world_to_camera.at(camera.shading_time());
    let to_normal = to_camera.normal_matrix();
    let mut offset = 0;
    let mut found = Vec::new();
    for (name, ty) in wanted {
        let (from, width) = (offset * n, ty.components());
        offset += width;
        let base = match ty {
            ValueType::Color => BaseType::Color,
            ValueType::Point => BaseType::Point,
            ValueType::Vector => BaseType::Vector,
            ValueType::Normal => BaseType::Normal,
            ValueType::Matrix => BaseType::Matrix,
            _ => BaseType::Float,
        };
        // Names of array elements cannot be declared.
        let is_part_of_patch = matches!(&**name, "P" | "C" | "opacity") || name.contains('[');
        let Some(values) = grid.shades[0].variables.get(from..from + width * n).filter(|_| !is_part_of_patch)
        else {
            continue;
        };
        let mut values = values.to_vec();
        let move_by: Option<&dyn Fn(Vec3) -> Vec3> = match base {
            BaseType::Point => Some(&|v| to_camera.point(v)),
            BaseType::Vector => Some(&|v| to_camera.vector(v)),
            BaseType::Normal => Some(&|v| to_normal.vector(v)),
            _ => None,
        };
        if let Some(move_by) = move_by {
            for i in 0..n {
                let v = move_by(Vec3::new(values[i], values[n + i], values[2 * n + i])).to_array();
                (0..3).for_each(|c| values[c * n + i] = v[c]);
            }
        }
        found.push(Variable { name, base, width, values });
    }
    found
}

/// A rectangle of points of a grid.
struct Part {
    /// The first and the last point along u.
    u: [usize; 2],
    /// The first and the last point along v.
    v: [usize; 2],
    /// True for each side that is a boundary edge of the grid, in the order v = 0, u = 1, v = 1, u = 0.
    sides: [bool; 4],
}

/// Returns rectangles that cover the existing micropolygons, each once. They are runs along u, which grow along v while
/// the next row has the same run.
fn parts(grid: &ShadedGrid, points: &[Vec<Vec3>]) -> Vec<Part> {
    let (nu, nv) = (grid.nu, grid.nv);
    let (mu, mv) = (nu - 1, nv - 1);
    let placed = |at: usize| points.iter().all(|p| p[at].is_finite());
    let there = |i: usize, j: usize| {
        let at = j * nu + i;
        grid.kept.get(j * mu + i).is_none_or(|kept| *kept)
            && [at, at + 1, at + nu, at + nu + 1].into_iter().all(placed)
    };
    let mut done: Vec<Part> = Vec::new();
    // The rectangles that end at the current row.
    let mut open: Vec<Part> = Vec::new();
    for j in 0..mv {
        let mut runs: Vec<[usize; 2]> = Vec::new();
        for i in (0..mu).filter(|i| there(*i, j)) {
            match runs.last_mut() {
                Some(run) if run[1] == i => run[1] = i + 1,
                _ => runs.push([i, i + 1]),
            }
        }
        let mut next = Vec::with_capacity(runs.len());
        for run in runs {
            next.push(match open.iter().position(|part| part.u == run) {
                Some(at) => Part { v: [open[at].v[0], j + 1], ..open.swap_remove(at) },
                None => Part { u: run, v: [j, j + 1], sides: [false; 4] },
            });
        }
        done.append(&mut open);
        open = next;
    }
    done.append(&mut open);
    for part in &mut done {
        part.sides = [part.v[0] == 0, part.u[1] == mu, part.v[1] == mv, part.u[0] == 0];
        (0..4).for_each(|k| part.sides[k] &= grid.sides[k]);
    }
    done.sort_by_key(|part| (part.v, part.u));
    done
}

/// Returns the patch of a part at one time.
fn patch(grid: &ShadedGrid, part: &Part, p: &[Vec3], variables: &[Variable<'_>]) -> Call {
    let n = grid.nu * grid.nv;
    let points: Vec<usize> =
        (part.v[0]..=part.v[1]).flat_map(|j| (part.u[0]..=part.u[1]).map(move |i| j * grid.nu + i)).collect();
    let triples = |values: &[Vec3]| -> ParamData {
        points
            .iter()
            .flat_map(|i| values.get(*i).copied().unwrap_or(Color::ZERO).to_array())
            .collect::<Vec<f32>>()
            .as_slice()
            .into()
    };
    // The first shading is written.
    let shade = &grid.shades[0];
    let mut params =
        vec![param("vertex point P", triples(p)), param("vertex color C", triples(&shade.color))];
    params.push(match shade.opacity.is_empty() {
        true => param("color opacity", &[1.0_f32; 3][..]),
        false => param("vertex color opacity", triples(&shade.opacity)),
    });
    for variable in variables {
        let values: Vec<f32> = points
            .iter()
            .flat_map(|i| (0..variable.width).map(move |c| variable.values[c * n + i]))
            .collect();
        let ty = ParamType::of(variable.base).with_interp(Interp::Vertex);
        params.push(Param { name: variable.name.clone(), ty, data: values.as_slice().into() });
    }
    params.push(param(&format!("int {}", preshaded::PRIMITIVE), grid.primitive.cast_signed()));
    let rim = part.sides.map(|side| if side { grid.views[0].rim_px } else { 0.0 });
    params.push(param(&format!("float[4] {}", preshaded::RIM), &rim[..]));
    let (nu, nv) = (part.u[1] - part.u[0] + 1, part.v[1] - part.v[0] + 1);
    let shape = ShapeDesc::Patch { u: CurveBasis::Linear, v: CurveBasis::Linear, nu, nv };
    Call::Shape { shape: Box::new(shape), params: Params(params) }
}

/// Returns a parameter. The declaration must be valid.
fn param(declaration: &str, data: impl Into<ParamData>) -> Param {
    Param::declared(declaration, data).expect("invariant: these declarations can be read")
}

/// True when a transform from object to camera space is the identity except for rounding, as for a grid in "camera"
/// space. The points of such a grid are taken unchanged.
pub(crate) fn is_identity(to_camera: &Transform, world_to_camera: &Transform) -> bool {
    let far = world_to_camera.to_rows().into_iter().fold(1.0, |far: f32, x| far.max(x.abs()));
    let rows = to_camera.to_rows();
    rows.iter().zip(Transform::IDENTITY.to_rows()).all(|(a, b)| (a - b).abs() <= 1e-5 * far)
}

#[cfg(test)]
mod tests {
    use super::*;
    use granita_base::Reporter;
    use granita_hider::{Shade, ViewedGrid};

    fn camera() -> CameraView {
        let camera = granita_scene::Camera {
            name: "main".into(),
            world_to_camera: Transform::translate(Vec3::Z).into(),
            params: Params::new(),
        };
        CameraView::new(&camera, &Reporter::silent())
    }

    /// Returns a flat grid of `nu` by `nv` points, with the index of each point as a variable.
    fn grid(nu: usize, nv: usize, kept: Vec<bool>) -> ShadedGrid {
        let p: Vec<Vec3> = (0..nu * nv).map(|i| Vec3::new((i % nu) as f32, (i / nu) as f32, 3.0)).collect();
        let color = p.clone();
        let view = ViewedGrid { rim_px: 0.02, ..ViewedGrid::new(&camera(), nu, vec![0.0], vec![p], false) };
        ShadedGrid {
            nu,
            nv,
            primitive: 7,
            number: 7,
            views: [view].into(),
            shades: vec![Shade {
                color,
                variables: (0..nu * nv).map(|i| i as f32).collect(),
                ..Shade::default()
            }],
            opaque: true,
            holdout: Holdout::None,
            kept,
            sides: [true; 4],
        }
    }

    fn described<'a>(
        camera: &'a CameraView,
        variables: &'a [(Arc<str>, ValueType)],
        order: u32,
    ) -> Described<'a> {
        Described { order: (0, order), name: "".into(), variables, eye: camera }
    }

    fn text(calls: Vec<Call>, _: bool) -> io::Result<Vec<u8>> {
        Ok(format!("{calls:?}\n").into_bytes())
    }

    #[test]
    fn parts_cover_the_kept_cells_of_a_grid_once() {
        let (nu, nv) = (9, 7);
        let mut state = 5_u32;
        for density in [0_u32, 20, 50, 90, 100] {
            let kept: Vec<bool> = (0..(nu - 1) * (nv - 1))
                .map(|_| {
                    state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                    (state >> 16) % 100 < density
                })
                .collect();
            let grid = grid(nu, nv, kept.clone());
            let mut covered = vec![0; kept.len()];
            for part in parts(&grid, &grid.views[0].p_cam) {
                assert_eq!(
                    part.sides,
                    [part.v[0] == 0, part.u[1] == nu - 1, part.v[1] == nv - 1, part.u[0] == 0]
                );
                for j in part.v[0]..part.v[1] {
                    (part.u[0]..part.u[1]).for_each(|i| covered[j * (nu - 1) + i] += 1);
                }
            }
            assert!(covered.iter().zip(&kept).all(|(n, kept)| *n == i32::from(*kept)), "{density}");
        }
        let mut holed = grid(4, 4, Vec::new());
        Arc::make_mut(&mut holed.views)[0].p_cam[0][5].z = f32::NAN;
        let cells = |p: &Part| (p.u[1] - p.u[0]) * (p.v[1] - p.v[0]);
        assert_eq!(parts(&holed, &holed.views[0].p_cam).iter().map(cells).sum::<usize>(), 5);
        assert_eq!(parts(&grid(4, 4, Vec::new()), &[]).len(), 1);
    }

    #[test]
    fn a_dumped_patch_has_the_computed_variables() {
        let camera = camera();
        let variables = [("id".into(), ValueType::Float)];
        let mut grid = grid(3, 2, vec![false, true]);
        grid.holdout = Holdout::Shaded;
        let calls = calls(&grid, &described(&camera, &variables, 0), &camera);
        let [
            Call::PushAttributes,
            Call::Attribute(holdout),
            Call::Shape { shape, params },
            Call::PopAttributes,
        ] = &calls[..]
        else {
            panic!("{calls:?}")
        };
        assert_eq!(holdout.declaration(), "int holdout");
        assert!(matches!(**shape, ShapeDesc::Patch { nu: 2, nv: 2, .. }));
        assert_eq!(params.floats("id").unwrap()[..], [1.0, 2.0, 4.0, 5.0]);
        assert_eq!(params.floats("P").unwrap()[..6], [1.0, 0.0, 3.0, 2.0, 0.0, 3.0]);
        assert_eq!(params.floats(preshaded::RIM).unwrap()[..], [0.02, 0.02, 0.02, 0.0]);
    }

    #[test]
    fn the_dump_does_not_depend_on_the_order_of_grids() {
        let folder = tempfile::tempdir().unwrap();
        let camera = camera();
        let write = |name: &str, order: &[u32]| {
            let path = folder.path().join(name);
            let dump = GridDump::new(&path, &Files::default(), false, text, &camera).unwrap();
            for k in order {
                dump.add(&grid(2, 2 + *k as usize, Vec::new()), &described(&camera, &[], *k));
            }
            assert!(!path.exists());
            dump.finish().unwrap();
            std::fs::read(&path).unwrap()
        };
        let a = write("a", &[0, 1, 2, 3]);
        assert_eq!(a, write("b", &[3, 1, 0, 2]));
        assert_eq!(a.iter().filter(|c| **c == b'\n').count(), 5);
    }

    #[test]
    fn a_failed_dump_keeps_the_old_file() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("grids");
        std::fs::write(&path, "old").unwrap();
        let camera = camera();
        let dump = GridDump::new(
            &path,
            &Files::default(),
            false,
            |_, _| Err(io::Error::other("the disk is full")),
            &camera,
        )
        .unwrap();
        dump.add(&grid(2, 2, Vec::new()), &described(&camera, &[], 0));
        assert!(dump.finish().unwrap_err().to_string().contains("the disk is full"));
        drop(GridDump::new(&path, &Files::default(), false, text, &camera).unwrap());
        assert_eq!(std::fs::read(&path).unwrap(), b"old");
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
        let nowhere =
            GridDump::new(&folder.path().join("no/such"), &Files::default(), false, text, &camera).unwrap();
        assert!(nowhere.finish().is_err());
    }
}
