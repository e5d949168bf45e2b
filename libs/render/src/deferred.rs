//! Finds the deferred inputs (reference 2.9) that a frame may need.
//!
//! An input is needed unless it is certain that it is not. A bound outside of every camera's pixels is not visible,
//! and rays only intersect geometry sets, which shaders request by name.

use crate::output::plan::is_dynamic;
use crate::{CameraView, Renderer, ShaderLibrary};
use granita_base::{Bound, ParamData, Vec3};
use granita_dicing::Placement;
use granita_dicing::camera::is_moving;
use granita_dicing::longest_axis;
use granita_gsl::ir::{
    Block, ConstValue, DefaultValue, Module, OpCode, Stmt, SymbolId, SymbolKind, ValueType,
};
use granita_gsl::{Func, ValidModule};
use granita_hider::{NOWHERE, Projector, SamplePattern, pixels_of};
use granita_scene::{AttributeSet, DeferredInput, Scene, ShaderGroup, ShaderInstance, attr};
use granita_shading::Spaces;
use std::collections::BTreeMap;
use std::sync::Arc;

impl Renderer {
    /// Returns for each of these inputs whether it may be visible or hit by a ray when `scene` is rendered.
    pub fn needed(&self, scene: &Scene, unread: &[DeferredInput]) -> Vec<bool> {
        let views = self.views(scene);
        let Some(first) = views.first().map(CameraView::shading_view) else {
            return vec![true; unread.len()];
        };
        // Samples depend on whether anything moves, and a deferred input may move.
        let moves = views.iter().any(|v| SamplePattern::blurs(v, true) && !is_moving(scene, v));
        if moves || RaySeeker::new(&*self.environment.shaders).may_trace(scene, unread) {
            return vec![true; unread.len()];
        }
        let spaces = Spaces::new(scene, &first);
        let margin = margin(scene);
        // Shaders may look up all of a map that is made on demand.
        let maps = |v: &CameraView| scene.outputs.iter().any(|o| o.camera == v.name && is_dynamic(o));
        let whole = |v: CameraView| if maps(&v) { v.uncropped() } else { v };
        let views: Vec<CameraView> = views.into_iter().map(whole).collect();
        let seen = |v: &CameraView| scene.outputs.iter().any(|o| o.camera == v.name) && !v.crop.is_empty();
        let eyes = |v: &CameraView| v.eyes().map_or_else(|| vec![v.clone()], Vec::from);
        let views: Vec<CameraView> = views.iter().filter(|v| seen(v)).flat_map(eyes).collect();
        unread
            .iter()
            .map(|input| {
                let displacement = displacement_world(&input.attributes, &spaces);
                views.iter().any(|view| may_see(view, margin, input, displacement))
            })
            .collect()
    }
}

/// Returns the number of pixels beyond the image that its filters may need.
fn margin(scene: &Scene) -> i32 {
    let widths = scene.outputs.iter().flat_map(|output| output.get(attr::FILTERWIDTH));
    let widest = widths.fold(4.0_f32, f32::max);
    (widest * 0.5).ceil() as i32 + 1
}

/// Returns the bound of displacement in world units. The input may contain a displacement shader.
fn displacement_world(attributes: &AttributeSet, spaces: &Spaces) -> f32 {
    let space = attributes.get(attr::DISPLACE_MAXSPACE);
    let scale = spaces
        .of_object(&space, attributes, spaces.shading_time())
        .map_or(1.0, |m| longest_axis(|v| m.vector(v)));
    (attributes.get(attr::DISPLACE_MAXRADIUS) * scale).max(0.0)
}

/// True when the camera may see a part of a bound at any time of the shutter.
fn may_see(view: &CameraView, margin: i32, input: &DeferredInput, displacement_world: f32) -> bool {
    let object = Bound::from_extents(&input.bound);
    let to_world = &input.attributes.to_world;
    let placement = Placement::new(to_world, &[], &[&view.world_to_camera], view.shutter);
    let hull = placement.times().iter().fold(Bound::EMPTY, |hull, &time| {
        let to_camera = view.world_to_camera.at(time);
        let stretch = [Vec3::X, Vec3::Y, Vec3::Z].map(|a| to_camera.vector(a).length());
        let bound = object.transformed(&to_world.at(time).then(&to_camera));
        hull.union(bound.padded(displacement_world * stretch.into_iter().fold(0.0, f32::max)))
    });
    if !hull.is_finite() {
        return true;
    }
    let bound_px = Projector::new(view, view.lens.is_some()).raster_box(&hull);
    if bound_px == NOWHERE {
        return false;
    }
    // The box is padded as for primitives, and by two more pixels against rounding.
    let bound_px = [bound_px[0] - 2.0, bound_px[1] - 2.0, bound_px[2] + 2.0, bound_px[3] + 2.0];
    bound_px.iter().any(|b| b.is_nan()) || !pixels_of(bound_px, &view.crop.grown(margin)).is_empty()
}

/// Finds whether shaders may trace rays.
struct RaySeeker<'a> {
    library: &'a dyn ShaderLibrary,
    /// For each shader: the operands that name geometry sets; `None` when it cannot be loaded.
    known: BTreeMap<Arc<str>, Option<Sets>>,
}

/// The operands of a shader that name geometry sets.
struct Sets {
    module: ValidModule,
    names: Vec<SymbolId>,
}

impl<'a> RaySeeker<'a> {
    fn new(library: &'a dyn ShaderLibrary) -> Self {
        Self { library, known: BTreeMap::new() }
    }

    fn may_trace(&mut self, scene: &Scene, unread: &[DeferredInput]) -> bool {
        let mut last = std::ptr::null();
        let sets = scene.primitives.iter().map(|p| &p.attributes);
        for set in sets.chain(unread.iter().map(|u| &u.attributes)) {
            if Arc::as_ptr(set) == last {
                continue;
            }
            last = Arc::as_ptr(set);
            let groups = [&set.surface, &set.displacement, &set.volume];
            if groups.into_iter().flatten().any(|group| self.group_may_trace(group)) {
                return true;
            }
        }
        scene.lights.iter().any(|light| self.group_may_trace(&light.group))
    }

    fn group_may_trace(&mut self, group: &ShaderGroup) -> bool {
        let wired = !group.connections.is_empty();
        group.layers.iter().any(|layer| self.layer_may_trace(layer, wired))
    }

    fn layer_may_trace(&mut self, layer: &ShaderInstance, wired: bool) -> bool {
        let library = self.library;
        let sets = self.known.entry(layer.shader.clone()).or_insert_with(|| {
            library.load(&layer.shader).ok().map(|module| Sets { names: set_operands(&module), module })
        });
        let Some(sets) = sets else { return false };
        let module = &sets.module;
        // The geometry that a light shines from is sampled like ray geometry.
        let from_geometry = module.param("geometry").map(|p| p.symbol);
        sets.names.iter().copied().chain(from_geometry).any(|id| match &module.symbol(id).kind {
            SymbolKind::Const(ConstValue::Strings(names)) => names.iter().any(|n| may_be_set(n)),
            SymbolKind::Param(k) if !wired => {
                let given = layer.params.get(&module.symbol(id).name).map(|p| &p.data);
                match (given, module.params.get(*k as usize).map(|p| &p.default)) {
                    (Some(ParamData::String(names)), _) => names.iter().any(|n| may_be_set(n)),
                    (_, Some(DefaultValue::Known { value: ConstValue::Strings(names), .. })) => {
                        names.iter().any(|n| may_be_set(n))
                    }
                    _ => true,
                }
            }
            _ => true,
        })
    }
}

/// True when a string may name a geometry set. Textures are files with an extension.
fn may_be_set(name: &str) -> bool {
    !name.is_empty() && !name.contains(['.', '/', '\\'])
}

/// Returns the operands of all operations in a shader that may trace rays.
fn set_operands(module: &Module) -> Vec<SymbolId> {
    let mut names = Vec::new();
    module.params.iter().for_each(|p| collect(module, &p.init, &mut names));
    collect(module, &module.body, &mut names);
    names
}

fn collect(module: &Module, block: &Block, names: &mut Vec<SymbolId>) {
    for statement in block {
        match statement {
            Stmt::Op(op) => {
                let traces = matches!(
                    op.code,
                    OpCode::Call(Func::Shadow | Func::Environment | Func::Indirect | Func::Occlusion)
                );
                names.extend(op.args.first().filter(|_| traces));
                // The external function may trace against a set that is an argument. Its first operand is its
                // description.
                if op.code == OpCode::Call(Func::Shadeop) {
                    let is_text = |id: &&SymbolId| module.symbol(**id).ty.value == ValueType::String;
                    names.extend(op.args.iter().skip(1).filter(is_text));
                }
            }
            Stmt::If { then, otherwise, .. } => {
                collect(module, then, names);
                collect(module, otherwise, names);
            }
            Stmt::Loop { test, body, step, .. } => {
                [test, body, step].into_iter().for_each(|b| collect(module, b, names));
            }
            Stmt::Trace { set, body, .. } => {
                names.push(*set);
                collect(module, body, names);
            }
            Stmt::Scope { body, .. } | Stmt::Lights { body, .. } | Stmt::Emit { body, .. } => {
                collect(module, body, names);
            }
            Stmt::Leave(_) | Stmt::Break | Stmt::Continue | Stmt::Exit => (),
        }
    }
}
