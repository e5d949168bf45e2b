//! What rendering needs to know of an attribute state, found out once.
//!
//! Attribute values are names and numbers in maps; thousands of grids ask the same few questions. An
//! [`ObjectState`] holds the answers and the linked shaders.

use crate::spaces::Spaces;
use crate::{NoShader, ShaderLibrary};
use granita_base::{Color, Location, MotionTransform, Reporter, Severity, Vec3};
use granita_gsl::ir::{
    Global, Module, Op, OpCode, ShaderKind, SourcePos, Stmt, Symbol, SymbolId, SymbolKind, SymbolType,
};
use granita_scene::{AttributeSet, LightId, ShaderGroup, ShaderUsage, attr};
use granita_shade::{ConnectionSource, Group, LayerSource};
use std::sync::Arc;

/// The surface shader of objects that have none (reference 8.1.1).
pub(crate) const DEFAULT_SURFACE: &str = "defaultsurface";

/// Shaders of one usage, linked, with the spaces of their layers.
#[derive(Debug)]
pub(crate) struct LinkedShaders {
    /// Ready to run.
    pub(crate) group: Group,
    /// What it is attached as.
    pub(crate) usage: ShaderUsage,
    /// Shader name of each layer, for messages.
    pub(crate) names: Vec<Arc<str>>,
    /// "shader" space of each layer to world.
    pub(crate) to_world: Vec<MotionTransform>,
}

/// Where shaders come from and where messages about them go.
#[derive(Clone, Copy)]
pub(crate) struct Linker<'a> {
    /// Compiled shaders.
    pub(crate) library: &'a dyn ShaderLibrary,
    /// Receives messages.
    pub(crate) reporter: &'a Reporter,
}

impl Linker<'_> {
    /// Loads and links the layers of a group. Layers whose shader is missing, or may not be used so, are
    /// left out with one warning that names `owner` and the substitute; `None` when no layer is left.
    pub(crate) fn link(
        &self,
        shaders: &ShaderGroup,
        usage: ShaderUsage,
        owner: &str,
    ) -> Option<LinkedShaders> {
        let mut modules = Vec::with_capacity(shaders.layers.len());
        for layer in &shaders.layers {
            let name = &layer.shader;
            let module = match self.library.load(name) {
                Ok(module) => module,
                Err(why) => {
                    // What is wrong with a broken one was said as an error; this names who goes without it.
                    let (severity, why) = match why {
                        NoShader::Missing(places) => (Severity::Error, format!("is missing ({places})")),
                        NoShader::Broken => (Severity::Warning, "cannot be used".to_owned()),
                    };
                    let text = format!("\"{name}\" {why}; {}", substitute(usage));
                    self.once(severity, usage, owner, (name, &layer.at), &text);
                    continue;
                }
            };
            if let Err(reason) = may_be_used(&module, usage) {
                let text = format!("\"{name}\" {reason}; {}", substitute(usage));
                self.once(Severity::Warning, usage, owner, (name, &layer.at), &text);
                continue;
            }
            modules.push((module, layer));
        }
        if modules.is_empty() {
            return None;
        }
        let layers: Vec<LayerSource<'_>> = modules
            .iter()
            .map(|(module, layer)| LayerSource {
                module: module.clone(),
                params: &layer.params,
                name: layer.layer.as_deref(),
            })
            .collect();
        let connections: Vec<ConnectionSource<'_>> = shaders
            .connections
            .iter()
            .map(|c| ConnectionSource {
                source_layer: &c.source_layer,
                source: &c.source,
                target_layer: &c.target_layer,
                target: &c.target,
            })
            .collect();
        let first = modules[0].1;
        let mut report = |severity: Severity, text: String| {
            let text = self.prefixed(usage, owner, &text);
            self.reporter.once(&text, severity, &first.at, text.clone());
        };
        let linked = Group::link(&layers, &connections, &mut report)
            .and_then(|mut group| group.attach(kind(usage)).map(|()| group));
        let group = match linked {
            Ok(group) => group,
            Err(error) => {
                report(Severity::Error, format!("{error}; {}", substitute(usage)));
                return None;
            }
        };
        Some(LinkedShaders {
            group,
            usage,
            names: modules.iter().map(|(module, _)| module.name.clone()).collect(),
            to_world: modules.iter().map(|(_, layer)| layer.to_world.clone()).collect(),
        })
    }

    /// The surface shader of an object that has none, or whose shaders are all missing: the library's
    /// "defaultsurface", or one that keeps the surface colour.
    pub(crate) fn default_surface(&self) -> LinkedShaders {
        let module = self.library.load(DEFAULT_SURFACE).unwrap_or_else(|_| Arc::new(plain_surface()));
        let link = |module: Arc<Module>| {
            let params = granita_base::Params::new();
            let name = module.name.clone();
            let layer = LayerSource { module, params: &params, name: None };
            let group = Group::link(&[layer], &[], &mut |severity, text| {
                self.reporter.once(&text, severity, &Location::default(), text.clone());
            });
            group.map(|group| LinkedShaders {
                group,
                usage: ShaderUsage::Surface,
                names: vec![name],
                to_world: vec![MotionTransform::default()],
            })
        };
        link(module).unwrap_or_else(|error| {
            let text = format!("cannot link \"{DEFAULT_SURFACE}\": {error}");
            self.reporter.once(&text, Severity::Error, &Location::default(), text.clone());
            link(Arc::new(plain_surface())).expect("invariant: one multiplication of two globals links")
        })
    }

    fn prefixed(&self, usage: ShaderUsage, owner: &str, text: &str) -> String {
        match (usage, owner) {
            (ShaderUsage::Light, _) => format!("light \"{owner}\": {text}"),
            (_, "") => format!("{} shader: {text}", usage_word(usage)),
            _ => format!("object \"{owner}\": {} shader: {text}", usage_word(usage)),
        }
    }

    /// Once per shader and usage, however many objects have it.
    fn once(
        &self,
        severity: Severity,
        usage: ShaderUsage,
        owner: &str,
        (shader, at): (&str, &Location),
        text: &str,
    ) {
        let cause = format!("{} shader {shader} unusable", usage_word(usage));
        self.reporter.once(&cause, severity, at, self.prefixed(usage, owner, text));
    }
}

/// The word of a usage in scene files.
pub(crate) fn usage_word(usage: ShaderUsage) -> &'static str {
    match usage {
        ShaderUsage::Surface => "surface",
        ShaderUsage::Displacement => "displacement",
        ShaderUsage::Volume => "volume",
        ShaderUsage::Light => "light",
    }
}

/// The kind of shader for a usage.
pub(crate) fn kind(usage: ShaderUsage) -> ShaderKind {
    match usage {
        ShaderUsage::Surface => ShaderKind::Surface,
        ShaderUsage::Displacement => ShaderKind::Displacement,
        ShaderUsage::Volume => ShaderKind::Volume,
        ShaderUsage::Light => ShaderKind::Light,
    }
}

/// What happens instead of a shader that cannot be used.
fn substitute(usage: ShaderUsage) -> &'static str {
    match usage {
        ShaderUsage::Surface => "\"defaultsurface\" takes its place",
        ShaderUsage::Displacement => "the surface stays where it is",
        ShaderUsage::Volume => "the volume stays clear",
        ShaderUsage::Light => "the light stays dark",
    }
}

/// Whether a shader may be attached so (reference 2.6, 5.1.2).
fn may_be_used(module: &Module, usage: ShaderUsage) -> Result<(), String> {
    if module.kind == kind(usage) {
        return Ok(());
    }
    if module.kind != ShaderKind::Generic {
        return Err(format!("is a {} shader", module.kind.word()));
    }
    if usage != ShaderUsage::Displacement && module.writes.contains(&Global::P) {
        return Err("writes P, which only a displacement may".to_owned());
    }
    Ok(())
}

/// `C *= opacity`, for a house without even a "defaultsurface".
fn plain_surface() -> Module {
    let global = |g: Global| Symbol {
        name: g.word().into(),
        ty: SymbolType::of(g.value_type()),
        kind: SymbolKind::Global(g),
    };
    let (c, opacity) = (SymbolId(0), SymbolId(1));
    Module {
        kind: ShaderKind::Surface,
        name: DEFAULT_SURFACE.into(),
        metadata: Vec::new(),
        params: Vec::new(),
        symbols: vec![global(Global::C), global(Global::opacity)],
        body: vec![Stmt::Op(Op {
            code: OpCode::Mul,
            dst: Some(c),
            args: vec![c, opacity],
            at: SourcePos::default(),
        })],
        files: Vec::new(),
        reads: vec![Global::C, Global::opacity],
        writes: vec![Global::C],
        needs_derivatives: false,
    }
}

/// "holdout" (reference 4.4.4).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) enum Holdout {
    /// Ordinary.
    #[default]
    No,
    /// Blocks what is behind; shaders do not run.
    Matte,
    /// Blocks what is behind; shaders run.
    Shaded,
}

/// Everything about an attribute state that rendering asks for.
#[derive(Debug)]
pub(crate) struct ObjectState {
    /// What it was made of.
    pub(crate) attributes: Arc<AttributeSet>,
    /// "name", for messages.
    pub(crate) name: Arc<str>,
    /// Surface shaders.
    pub(crate) surface: Arc<LinkedShaders>,
    /// Displacement shaders.
    pub(crate) displacement: Option<Arc<LinkedShaders>>,
    /// Volume shaders.
    pub(crate) volume: Option<Arc<LinkedShaders>>,
    /// The grids of the primitive come shaded: no shader runs (reference 4.3.7).
    pub(crate) preshaded: bool,
    /// Its grids may be shaded together: shaders look at points and their neighbours only.
    pub(crate) joins: bool,
    /// Shaders may save something.
    pub(crate) saves: bool,
    /// Known to be opaque without running a shader.
    pub(crate) opaque: bool,
    /// Opaque for shadow rays: `opaque`, or "ray:opaqueshadows".
    pub(crate) opaque_to_shadows: bool,
    /// "C".
    pub(crate) color: Color,
    /// "opacity".
    pub(crate) opacity: Color,
    /// "holdout".
    pub(crate) holdout: Holdout,
    /// Bound of displacement, in world units; 0 without a displacement shader.
    pub(crate) max_displacement_world: f32,
    /// "shadow:bias", in world units.
    pub(crate) shadow_bias: f32,
    /// "ray:motion": rays of this object see motion.
    pub(crate) ray_motion: bool,
    /// "ray:displace": displaced truly for rays, not only bumped.
    pub(crate) ray_displace: bool,
    /// Lights that shine on it.
    pub(crate) lights: Arc<[LightId]>,
}

/// Shaders of a state that have already been linked.
pub(crate) struct StateShaders {
    /// Surface; the default one when the state has none.
    pub(crate) surface: Arc<LinkedShaders>,
    /// Displacement.
    pub(crate) displacement: Option<Arc<LinkedShaders>>,
    /// Volume.
    pub(crate) volume: Option<Arc<LinkedShaders>>,
}

impl ObjectState {
    /// Reads the attributes. `own_opacity`: the primitive carries an "opacity" variable of its own, so
    /// that the attribute says nothing about it.
    pub(crate) fn new(
        attributes: &Arc<AttributeSet>,
        shaders: StateShaders,
        own_opacity: bool,
        spaces: &Spaces,
    ) -> Self {
        let opacity = crate::finite::opacity(attributes);
        let solid = opacity == Vec3::ONE && !own_opacity && !shaders.surface.group.sets_opacity();
        let clear_air = shaders.volume.as_ref().is_none_or(|v| !v.group.sets_opacity());
        let opaque = solid && clear_air;
        let max_displacement_world = match &shaders.displacement {
            None => 0.0,
            Some(_) => {
                let space = attributes.get(attr::DISPLACE_MAXSPACE);
                let scale = spaces
                    .of_object(&space, attributes, spaces.shading_time())
                    .map_or(1.0, |m| longest_axis(|v| m.vector(v)));
                (attributes.get(attr::DISPLACE_MAXRADIUS) * scale).max(0.0)
            }
        };
        Self {
            name: attributes.name(),
            preshaded: false,
            joins: false,
            saves: false,
            opaque,
            opaque_to_shadows: opaque || attributes.get(attr::RAY_OPAQUESHADOWS),
            color: attributes.get(attr::COLOR),
            opacity,
            holdout: match attributes.get(attr::HOLDOUT) {
                0 => Holdout::No,
                2 => Holdout::Shaded,
                _ => Holdout::Matte,
            },
            max_displacement_world,
            shadow_bias: attributes.get(attr::SHADOW_BIAS).max(0.0),
            ray_motion: attributes.get(attr::RAY_MOTION),
            ray_displace: attributes.get(attr::RAY_DISPLACE),
            lights: attributes.lights.iter().collect(),
            surface: shaders.surface,
            displacement: shaders.displacement,
            volume: shaders.volume,
            attributes: attributes.clone(),
        }
    }

    /// Whether displacement moves points for rays (and not only their normals).
    pub(crate) fn displaces_rays(&self) -> bool {
        self.ray_displace && self.moves_points()
    }

    /// Whether a displacement shader moves points (and not only normals).
    pub(crate) fn moves_points(&self) -> bool {
        self.displacement.as_ref().is_some_and(|d| d.group.writes(Global::P))
    }
}

/// Length of the longest of the three transformed unit axes.
pub(crate) fn longest_axis(vector: impl Fn(Vec3) -> Vec3) -> f32 {
    [Vec3::X, Vec3::Y, Vec3::Z].into_iter().map(|v| vector(v).length()).fold(0.0, f32::max)
}
