//! Geometric primitives, which are polygons, meshes, points and quadrics.

use crate::declare::Given;
use crate::loops;
use crate::options::{exactly, numbers};
use crate::primvars::{PATCH, POINTS, POLYGONS, Variable, params, variables};
use crate::quadrics::{self, Arcs};
use crate::reader::{Done, Fault, Reader, plain};
use crate::request::{Arg, Request};
use granita_base::{BaseType, Interp, Param, ParamData, ParamType, Params, ShapeDesc};
use std::sync::Arc;

/// Returns the integers of the argument with an index.
pub(crate) fn ints(request: &Request, at: usize) -> Result<Arc<[i32]>, Fault> {
    let found = request.args.get(at).and_then(Arg::ints);
    found.ok_or_else(|| Fault::Mistake(format!("argument {} should be integers", at + 1)))
}

/// Returns the first integer of the argument with an index.
pub(crate) fn int(request: &Request, at: usize) -> Result<usize, Fault> {
    let found = ints(request, at)?.first().copied().and_then(|n| usize::try_from(n).ok());
    found.ok_or_else(|| Fault::Mistake(format!("argument {} should be a number", at + 1)))
}

/// Returns the index at which the parameter list begins, which is that of the first string.
fn list_start(request: &Request) -> usize {
    request.args.iter().position(|a| a.floats().is_none()).unwrap_or(request.args.len())
}

impl Reader<'_> {
    /// Executes geometry requests. Returns `None` for other requests.
    pub(crate) fn geometry_request(&mut self, request: &Request) -> Option<Done> {
        Some(match request.name.as_str() {
            "Polygon" => self.polygon(request),
            "GeneralPolygon" => self.general_polygon(request),
            "PointsPolygons" => self.points_polygons(request),
            "PointsGeneralPolygons" => self.points_general_polygons(request),
            "SubdivisionMesh" | "HierarchicalSubdivisionMesh" => self.subdivision_mesh(request),
            "Points" => self.points(request),
            "Sphere" | "Cone" | "Cylinder" | "Disk" | "Hyperboloid" | "Paraboloid" | "Torus" => {
                self.quadric(request)
            }
            "Patch" => self.patch(request),
            "PatchMesh" => self.patch_mesh(request),
            "NuPatch" => self.nu_patch(request),
            "TrimCurve" => self.trim_curve(request),
            "Curves" => self.curves(request),
            "Blobby" | "ImplicitSurface" | "Volume" => {
                Err(Fault::Unsupported(format!("{} is not supported", request.name)))
            }
            _ => return None,
        })
    }

    /// Returns the parameter list. Heights ("Pz") are left out, because they do not give positions here.
    pub(crate) fn given(&mut self, request: &Request, from: usize) -> Vec<Given> {
        let mut list = self.params(request, from);
        if list.iter().any(|g| &*g.name == "Pz") {
            self.once(format!("{}: \"Pz\" belongs to patches and their meshes", request.name));
            list.retain(|g| &*g.name != "Pz");
        }
        list
    }

    fn polygon(&mut self, request: &Request) -> Done {
        let given = self.given(request, 0);
        let n = points_of(&given)?.len() / 3;
        self.mesh(false, [n as i32].into(), (0..n as i32).collect(), variables(&given, POLYGONS))
    }

    fn points_polygons(&mut self, request: &Request) -> Done {
        let (nverts, verts) = (ints(request, 0)?, ints(request, 1)?);
        let given = self.given(request, 2);
        self.mesh(false, nverts, verts, variables(&given, POLYGONS))
    }

    fn general_polygon(&mut self, request: &Request) -> Done {
        let nverts = ints(request, 0)?;
        let given = self.given(request, 1);
        let total: i64 = nverts.iter().map(|n| i64::from(*n)).sum();
        let n = points_of(&given)?.len() / 3;
        if total != n as i64 {
            return Err(Fault::Mistake(format!("{total} corners, but {n} points")));
        }
        self.with_holes(&[nverts.len() as i32], &nverts, (0..n as i32).collect(), given)
    }

    fn points_general_polygons(&mut self, request: &Request) -> Done {
        let (nloops, nverts, verts) = (ints(request, 0)?, ints(request, 1)?, ints(request, 2)?);
        let given = self.given(request, 3);
        self.with_holes(&nloops, &nverts, verts, given)
    }

    /// Makes polygons with several loops each.
    fn with_holes(&mut self, nloops: &[i32], nverts: &[i32], verts: Arc<[i32]>, given: Vec<Given>) -> Done {
        let p = points_of(&given)?;
        let total: i64 = nverts.iter().map(|n| i64::from((*n).max(0))).sum();
        if total != verts.len() as i64 {
            return Err(Fault::Mistake(format!("{total} corners, but {} indices", verts.len())));
        }
        let (mut faces, mut corners) = (Vec::new(), Vec::new());
        let (mut next, mut corner) = (0_usize, 0_usize);
        for n in nloops {
            let n = usize::try_from(*n).unwrap_or(0);
            let Some(lengths) = nverts.get(next..next.saturating_add(n)) else {
                return Err(Fault::Mistake(format!(
                    "more loops than the {} whose lengths are given",
                    nverts.len()
                )));
            };
            next += n;
            let loops: Vec<Vec<usize>> = lengths
                .iter()
                .map(|length| {
                    let length = usize::try_from(*length).unwrap_or(0);
                    corner += length;
                    (corner - length..corner).collect()
                })
                .collect();
            let polygon = loops::joined(&loops, &verts, &p);
            faces.push(polygon.len() as i32);
            corners.extend(polygon);
        }
        let new_verts: Arc<[i32]> = corners.iter().map(|c| verts.get(*c).copied().unwrap_or(0)).collect();
        let mut all = variables(&given, POLYGONS);
        for variable in all.iter_mut().filter(|v| v.interp == Interp::Linear) {
            if variable.items() == verts.len() {
                variable.data = variable.picked(corners.iter().copied());
            }
        }
        self.mesh(false, faces.into(), new_verts, all)
    }

    fn mesh(
        &mut self,
        subdivide: bool,
        nverts: Arc<[i32]>,
        verts: Arc<[i32]>,
        variables: Vec<Variable>,
    ) -> Done {
        self.shape(ShapeDesc::Mesh { subdivide, nverts, verts }, params(variables))
    }

    fn subdivision_mesh(&mut self, request: &Request) -> Done {
        let scheme = crate::options::string(request, 0)?;
        let (nverts, verts) = (ints(request, 1)?, ints(request, 2)?);
        let hierarchical = request.name.starts_with('H');
        // The tags are followed by counts, integers and floats (and strings in the hierarchical form).
        let tags = request.args.get(3).and_then(|a| match a {
            Arg::Strings(tags) => Some(tags.clone()),
            Arg::Ints(none) if none.is_empty() => Some([].into()),
            _ => None,
        });
        let (from, tags) = match tags {
            Some(tags) => (7 + usize::from(hierarchical), tags),
            None => (3, Arc::from([])),
        };
        let mut extra = Params::new();
        if !tags.is_empty() {
            let (counts, values) = (ints(request, 4)?, ints(request, 5)?);
            let floats = request.args.get(6).and_then(Arg::floats).unwrap_or_else(|| [].into());
            self.tags(&tags, &counts, (&values, &floats), if hierarchical { 3 } else { 2 }, &mut extra)?;
        }
        let subdivide = match &*scheme {
            "bilinear" => false,
            "catmull-clark" => true,
            other => {
                self.once(format!("SubdivisionMesh: \"{other}\" is not supported; catmull-clark is used"));
                true
            }
        };
        let given = self.given(request, from);
        let mut all = variables(&given, POLYGONS);
        let is_varying = |v: &Variable| {
            given.iter().any(|g| same(&g.name, &v.name) && g.declared.class == crate::declare::Class::Varying)
        };
        for variable in &mut all {
            // Varying values are interpolated over faces. They are not smoothed like positions.
            if subdivide && variable.interp == Interp::Vertex && is_varying(variable) {
                let n = variable.items();
                if verts.iter().all(|v| usize::try_from(*v).is_ok_and(|v| v < n)) {
                    variable.data = variable.picked(verts.iter().map(|v| *v as usize));
                    variable.interp = Interp::Linear;
                }
            }
        }
        let mut all = params(all);
        extra.0.into_iter().for_each(|p| all.set(p));
        self.shape(ShapeDesc::Mesh { subdivide, nverts, verts }, all)
    }

    /// Reads the tags of a subdivision mesh. Each tag has `kinds` counts of arguments.
    fn tags(
        &mut self,
        tags: &[Arc<str>],
        counts: &[i32],
        (values, numbers): (&[i32], &[f32]),
        kinds: usize,
        extra: &mut Params,
    ) -> Result<(), Fault> {
        let (mut holes, mut lengths, mut chains, mut corners) =
            (Vec::<i32>::new(), Vec::<i32>::new(), Vec::<i32>::new(), Vec::<i32>::new());
        let (mut chain_sharpness, mut corner_sharpness) = (Vec::<f32>::new(), Vec::<f32>::new());
        let (mut next, mut next_float) = (0_usize, 0_usize);
        for (k, tag) in tags.iter().enumerate() {
            let n = counts.get(kinds * k).and_then(|n| usize::try_from(*n).ok()).unwrap_or(0);
            let Some(own) = values.get(next..next.saturating_add(n)) else {
                return Err(Fault::Mistake(format!("tag \"{tag}\" has fewer integers than it says")));
            };
            next += n;
            let n = counts.get(kinds * k + 1).and_then(|n| usize::try_from(*n).ok()).unwrap_or(0);
            let Some(floats) = numbers.get(next_float..next_float.saturating_add(n)) else {
                return Err(Fault::Mistake(format!("tag \"{tag}\" has fewer numbers than it says")));
            };
            next_float += n;
            // There is one number for all, or one for each.
            let spread = |count: usize| match floats {
                [one] => Some(vec![*one; count]),
                many => (many.len() == count).then(|| many.to_vec()),
            };
            match &**tag {
                "crease" if own.len() > 1 => {
                    let Some(sharp) = spread(own.len() - 1) else {
                        return Err(Fault::Mistake(format!(
                            "a crease of {} edges with {} numbers",
                            own.len() - 1,
                            floats.len()
                        )));
                    };
                    // Each edge of a crease may have its own sharpness.
                    for (pair, sharp) in own.windows(2).zip(sharp) {
                        lengths.push(2);
                        chains.extend(pair);
                        chain_sharpness.push(sharp);
                    }
                }
                "corner" => {
                    let Some(sharp) = spread(own.len()) else {
                        return Err(Fault::Mistake(format!(
                            "{} corners with {} numbers",
                            own.len(),
                            floats.len()
                        )));
                    };
                    corners.extend(own);
                    corner_sharpness.extend(sharp);
                }
                "hole" => holes.extend(own),
                "interpolateboundary" => {
                    let border = own.first().copied().unwrap_or(1);
                    extra.set(plain("border", BaseType::Int, border.clamp(0, 2)));
                }
                "facevaryinginterpolateboundary" | "facevaryingpropagatecorners" => (),
                other => self.once(format!("SubdivisionMesh: the tag \"{other}\" is not supported")),
            }
        }
        let lists = [
            ("holes", holes),
            ("creaselengths", lengths),
            ("creaseindices", chains),
            ("cornerindices", corners),
        ];
        for (name, list) in lists.into_iter().filter(|(_, list)| !list.is_empty()) {
            let ty = ParamType::array(BaseType::Int, list.len() as u32);
            extra.set(Param { name: name.into(), ty, data: ParamData::Int(list.into()) });
        }
        let lists = [("creasesharpnesses", chain_sharpness), ("cornersharpnesses", corner_sharpness)];
        for (name, list) in lists.into_iter().filter(|(_, list)| !list.is_empty()) {
            let ty = ParamType::array(BaseType::Float, list.len() as u32);
            extra.set(Param { name: name.into(), ty, data: ParamData::Float(list.into()) });
        }
        Ok(())
    }

    fn points(&mut self, request: &Request) -> Done {
        let given = self.given(request, list_start(request));
        let n = points_of(&given)?.len() / 3;
        let mut all = variables(&given, POINTS);
        if !all.iter().any(|v| &*v.name == "width") {
            all.push(width(1.0));
        }
        self.shape(ShapeDesc::Points { n }, params(all))
    }

    fn quadric(&mut self, request: &Request) -> Done {
        let start = list_start(request);
        let given = self.given(request, start);
        let head = Request { args: request.args[..start].to_vec(), ..request.clone() };
        let all = |values: &[f32]| values.iter().map(|v| f64::from(*v)).collect::<Vec<f64>>();
        let none = || Fault::Mistake("it has no surface".to_owned());
        let arcs = if self.moves() { Arcs::Four } else { Arcs::Fewest };
        let (shape, pw) = match request.name.as_str() {
            "Sphere" => {
                let [radius, zmin, zmax, thetamax_deg] = exactly::<4>(&head)?;
                (ShapeDesc::Sphere { radius, zmin, zmax, thetamax_deg }, None)
            }
            "Cone" => some(quadrics::cone(exactly::<3>(&head)?.map(f64::from), arcs)),
            "Cylinder" => some(quadrics::cylinder(exactly::<4>(&head)?.map(f64::from), arcs)),
            "Disk" => some(quadrics::disk(exactly::<3>(&head)?.map(f64::from), arcs)),
            "Paraboloid" => {
                some(quadrics::paraboloid(exactly::<4>(&head)?.map(f64::from), arcs).ok_or_else(none)?)
            }
            "Torus" => some(quadrics::torus(exactly::<5>(&head)?.map(f64::from), arcs)),
            _ => {
                let v = all(&exactly::<7>(&head)?);
                some(quadrics::hyperboloid([v[0], v[1], v[2]], [v[3], v[4], v[5]], v[6], arcs))
            }
        };
        if !numbers(&head.args).iter().all(|x| x.is_finite()) {
            return Err(Fault::Mistake("numbers that are not finite".to_owned()));
        }
        // A quadric has only four corners, for any class.
        let mut variables = variables(&given, PATCH);
        for variable in &mut variables {
            if variable.interp == Interp::Vertex {
                variable.interp = Interp::Linear;
            }
        }
        self.corners(&mut variables);
        let mut all = params(variables);
        pw.into_iter().for_each(|p| all.set(p));
        self.shape(shape, all)
    }

    /// Adds the `TextureCoordinates` to a primitive that does not have its own.
    pub(crate) fn corners(&self, variables: &mut Vec<Variable>) {
        let Some(c) = &self.local.corners else { return };
        for (name, at) in [("s", 0), ("t", 1)] {
            if !variables.iter().any(|v| &*v.name == name) {
                let values: Arc<[f32]> = (0..4).map(|k| c[2 * k + at]).collect();
                variables.push(Variable {
                    name: name.into(),
                    base: BaseType::Float,
                    array: None,
                    interp: Interp::Linear,
                    data: ParamData::Float(values),
                });
            }
        }
    }
}

fn some((shape, pw): (ShapeDesc, Param)) -> (ShapeDesc, Option<Param>) {
    (shape, Some(pw))
}

/// True when a given parameter became the variable of this name.
pub(crate) fn same(given: &str, variable: &str) -> bool {
    given == variable
        || matches!((given, variable), ("Cs", "C") | ("Os", "opacity") | ("Np", "N") | ("st", "s" | "t"))
}

/// Returns a width that is the same everywhere.
pub(crate) fn width(value: f32) -> Variable {
    Variable {
        name: "width".into(),
        base: BaseType::Float,
        array: None,
        interp: Interp::Constant,
        data: value.into(),
    }
}

/// Returns the positions, with three floats each.
pub(crate) fn points_of(given: &[Given]) -> Result<Arc<[f32]>, Fault> {
    let p = given.iter().find(|g| &*g.name == "P").map(Given::floats);
    p.ok_or_else(|| Fault::Mistake("no \"P\"".to_owned()))
}
