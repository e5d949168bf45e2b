//! The properties of an attribute state that rendering needs, computed once.
//!
//! Attribute values are names and numbers in maps, and thousands of grids need the same few of them. An
//! [`ObjectState`] holds these values and the linked shaders.

use crate::spaces::Spaces;
use crate::{NoShader, ShaderLibrary};
use granita_base::{Color, Location, MotionTransform, Reporter, Severity, Vec3};
use granita_gsl::ir::{Global, Module, ShaderKind};
use granita_gsl::{CompileOptions, ValidModule};
use granita_rays::{RayDisplacement, RayObject};
use granita_scene::{AttributeSet, Holdout, LightId, ShaderGroup, ShaderUsage, attr};
use granita_shade::{ConnectionSource, Group, LayerSource};
use parking_lot::RwLock;
use std::cell::Cell;
use std::sync::Arc;

/// The surface shader of objects that have none (reference 8.1.1).
pub const DEFAULT_SURFACE: &str = "defaultsurface";

/// The linked shaders of one usage, with the spaces of their layers.
#[derive(Debug)]
pub struct LinkedShaders {
    /// The linked group.
    pub group: Group,
    /// The usage that it is attached for.
    pub usage: ShaderUsage,
    /// The shader name of each layer, for messages.
    pub names: Vec<Arc<str>>,
    /// The transformation from the "shader" space of each layer to world space.
    pub to_world: Vec<MotionTransform>,
}

/// The source of shaders and the receiver of messages about them.
#[derive(Clone, Copy)]
pub(crate) struct Linker<'a> {
    /// The compiled shaders.
    pub(crate) library: &'a dyn ShaderLibrary,
    /// Receives messages.
    pub(crate) reporter: &'a Reporter,
    /// Set to true when a shader or a parameter cannot be used, whether that was reported before or not.
    pub(crate) complains: Option<&'a Cell<bool>>,
}

/// True when a light can be used as it was declared: all of its shaders load and link, with all of their parameters.
/// What cannot be used is reported.
pub fn check_light(
    name: &str,
    group: &ShaderGroup,
    library: &dyn ShaderLibrary,
    reporter: &Reporter,
) -> bool {
    let complains = Cell::new(false);
    let linker = Linker { library, reporter, complains: Some(&complains) };
    linker.link(group, ShaderUsage::Light, name).is_some() && !complains.get()
}

impl Linker<'_> {
    /// Loads and links the layers of a group. Layers whose shader is missing or not permitted for the usage are
    /// left out, with one warning that names `owner` and the substitute. Returns `None` when no layer is left.
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
                    // The error in a broken shader was already reported. This message names the object that lacks
                    // the shader.
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
            self.complain(severity);
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

    /// Returns the surface shader of an object that has none, or whose shaders are all missing. This is the
    /// library's "defaultsurface", or a shader that keeps the surface colour.
    pub(crate) fn default_surface(&self) -> LinkedShaders {
        let module = self.library.load(DEFAULT_SURFACE).unwrap_or_else(|_| plain_surface());
        let link = |module: ValidModule| {
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
            link(plain_surface()).expect("invariant: one multiplication of two globals links")
        })
    }

    fn complain(&self, severity: Severity) {
        if let Some(complains) = self.complains
            && matches!(severity, Severity::Error | Severity::Warning)
        {
            complains.set(true);
        }
    }

    fn prefixed(&self, usage: ShaderUsage, owner: &str, text: &str) -> String {
        match (usage, owner) {
            (ShaderUsage::Light, _) => format!("light \"{owner}\": {text}"),
            (_, "") => format!("{} shader: {text}", usage_word(usage)),
            _ => format!("object \"{owner}\": {} shader: {text}", usage_word(usage)),
        }
    }

    /// Reports once per shader and usage, however many objects have it.
    fn once(
        &self,
        severity: Severity,
        usage: ShaderUsage,
        owner: &str,
        (shader, at): (&str, &Location),
        text: &str,
    ) {
        self.complain(severity);
        let cause = format!("{} shader {shader} unusable", usage_word(usage));
        self.reporter.once(&cause, severity, at, self.prefixed(usage, owner, text));
    }
}

/// Returns the word for a usage in scene files.
pub(crate) fn usage_word(usage: ShaderUsage) -> &'static str {
    match usage {
        ShaderUsage::Surface => "surface",
        ShaderUsage::Displacement => "displacement",
        ShaderUsage::Volume => "volume",
        ShaderUsage::Light => "light",
    }
}

/// Returns the kind of shader for a usage.
pub(crate) fn kind(usage: ShaderUsage) -> ShaderKind {
    match usage {
        ShaderUsage::Surface => ShaderKind::Surface,
        ShaderUsage::Displacement => ShaderKind::Displacement,
        ShaderUsage::Volume => ShaderKind::Volume,
        ShaderUsage::Light => ShaderKind::Light,
    }
}

/// Describes what replaces a shader that cannot be used.
fn substitute(usage: ShaderUsage) -> &'static str {
    match usage {
        ShaderUsage::Surface => "\"defaultsurface\" is used",
        ShaderUsage::Displacement => "the surface is not displaced",
        ShaderUsage::Volume => "there is no volume effect",
        ShaderUsage::Light => "the light emits nothing",
    }
}

/// Checks that a shader may be attached for a usage (reference 2.6, 5.1.2).
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

/// Returns the shader of objects when "defaultsurface" cannot be loaded either.
fn plain_surface() -> ValidModule {
    let source = format!("surface {DEFAULT_SURFACE} () {{ C *= opacity; }}");
    let compiled = granita_gsl::compile(&source, DEFAULT_SURFACE, &CompileOptions::default());
    compiled.expect("invariant: one multiplication of two globals compiles").module
}

/// The properties of an attribute state that rendering needs.
#[derive(Debug)]
pub struct ObjectState {
    /// The attributes that it was made from.
    pub attributes: Arc<AttributeSet>,
    /// The attribute "name", for messages.
    pub name: Arc<str>,
    /// Surface shaders.
    pub surface: Arc<LinkedShaders>,
    /// Displacement shaders.
    pub displacement: Option<Arc<LinkedShaders>>,
    /// Volume shaders.
    pub volume: Option<Arc<LinkedShaders>>,
    /// True when the grids of the primitive are preshaded, so that no shader runs (reference 4.3.7).
    pub preshaded: bool,
    /// True when its grids may be batched, because its shaders read only points and their neighbours.
    pub may_batch: bool,
    /// True when shaders may save data.
    pub saves: bool,
    /// True when the object is opaque whatever its shaders compute.
    pub opaque: bool,
    /// True when the object is opaque to shadow rays: `opaque`, or "ray:opaqueshadows".
    pub opaque_to_shadows: bool,
    /// "C".
    pub color: Color,
    /// "opacity".
    pub opacity: Color,
    /// "holdout".
    pub holdout: Holdout,
    /// The bound of the displacement in world units; 0 without a displacement shader.
    pub max_displacement_world: f32,
    /// "shadow:bias", in world units.
    pub shadow_bias: f32,
    /// True when rays that this object traces see motion ("ray:motion").
    pub ray_motion: bool,
    /// True when the object is displaced for rays and not only bumped ("ray:displace").
    pub ray_displace: bool,
    /// The lights that illuminate it. A re-render may change them.
    pub(crate) lights: RwLock<Arc<[LightId]>>,
    /// True when the parameters and messages of its displacement shaders stay on its grids.
    pub(crate) displacement_says: bool,
    /// Its number in the context. Results of shading that depend on its lights name it.
    pub(crate) number: u32,
}

/// The linked shaders of a state.
pub struct StateShaders {
    /// The surface shaders, or the default one when the state has none.
    pub surface: Arc<LinkedShaders>,
    /// The displacement shaders.
    pub displacement: Option<Arc<LinkedShaders>>,
    /// The volume shaders.
    pub volume: Option<Arc<LinkedShaders>>,
}

impl ObjectState {
    /// Reads the attributes. `own_opacity` is true when the primitive has an "opacity" variable, which overrides
    /// the attribute.
    pub fn new(
        attributes: &Arc<AttributeSet>,
        shaders: StateShaders,
        own_opacity: bool,
        spaces: &Spaces,
    ) -> Self {
        let opacity = granita_dicing::finite::opacity(attributes);
        let solid = opacity == Vec3::ONE && !own_opacity && !shaders.surface.group.sets_opacity();
        let clear_air = shaders.volume.as_ref().is_none_or(|v| !v.group.sets_opacity());
        let opaque = solid && clear_air;
        let max_displacement_world = match &shaders.displacement {
            None => 0.0,
            Some(_) => {
                let space = attributes.get(attr::DISPLACE_MAXSPACE);
                let scale = spaces
                    .of_object(&space, attributes, spaces.shading_time())
                    .map_or(1.0, |m| granita_dicing::longest_axis(|v| m.vector(v)));
                (attributes.get(attr::DISPLACE_MAXRADIUS) * scale).max(0.0)
            }
        };
        Self {
            name: attributes.name(),
            preshaded: false,
            may_batch: false,
            saves: false,
            opaque,
            opaque_to_shadows: opaque || attributes.get(attr::RAY_OPAQUESHADOWS),
            color: attributes.get(attr::COLOR),
            opacity,
            holdout: attributes.holdout(),
            max_displacement_world,
            shadow_bias: attributes.get(attr::SHADOW_BIAS).max(0.0),
            ray_motion: attributes.get(attr::RAY_MOTION),
            ray_displace: attributes.get(attr::RAY_DISPLACE),
            lights: RwLock::new(attributes.lights.iter().collect()),
            displacement_says: false,
            number: 0,
            surface: shaders.surface,
            displacement: shaders.displacement,
            volume: shaders.volume,
            attributes: attributes.clone(),
        }
    }

    /// Returns the lights that illuminate it.
    pub fn lights(&self) -> Arc<[LightId]> {
        self.lights.read().clone()
    }

    /// True when the displacement moves points for rays, and not only their normals.
    pub fn displaces_rays(&self) -> bool {
        self.ray_displace && self.moves_points()
    }

    /// Returns the shaders that run where a ray hits the object. A displacement shader is among them only when it
    /// bumps.
    pub fn at_ray_hits(&self) -> impl Iterator<Item = &Arc<LinkedShaders>> {
        let bumps = self.displacement.as_ref().filter(|_| !self.displaces_rays());
        [Some(&self.surface), self.volume.as_ref(), bumps].into_iter().flatten()
    }

    /// True when a displacement shader moves points, and not only normals.
    pub fn moves_points(&self) -> bool {
        self.displacement.as_ref().is_some_and(|d| d.group.writes(Global::P))
    }
}

/// A geometry set of such objects.
pub(crate) type RayScene = granita_rays::RayScene<ObjectState>;

impl RayObject for ObjectState {
    fn name(&self) -> &Arc<str> {
        &self.name
    }

    fn attributes(&self) -> &AttributeSet {
        &self.attributes
    }

    fn color_and_opacity(&self) -> [Color; 2] {
        [self.color, self.opacity]
    }

    fn is_opaque_to_shadows(&self) -> bool {
        self.opaque_to_shadows
    }

    fn displacement(&self) -> RayDisplacement {
        match &self.displacement {
            None => RayDisplacement::None,
            Some(_) if self.displaces_rays() => {
                RayDisplacement::Moves { bound_world: self.max_displacement_world }
            }
            Some(_) => RayDisplacement::Bumps,
        }
    }

    fn queries_parent(&self) -> bool {
        self.at_ray_hits().any(|s| s.group.queries_parent())
    }
}
