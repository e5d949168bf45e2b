//! The surroundings of a shader that runs without a renderer. There is one space, units scale by their definition,
//! lights are given by name, textures are files, and there are no rays.

use granita_base::sample::{Draw, Sequence};
use granita_base::{Param, Reporter, SearchPath, Severity, Transform, hash};
use granita_gsl::ir::ShaderKind;
use granita_plugin::Plugins;
use granita_shade::{
    Databases, EnvironmentQuery, Executor, Grid, Group, Host, IlluminateQuery, Lanes3, LightInfo,
    LightResult, Lights, LookupResult, Messages, Rays, Recall, Shadeop, ShadowQuery, Spaces, Texture3dQuery,
    TextureQuery, Textures,
};
use granita_shading::lookups;
use granita_texture::TextureCache;
use std::sync::Arc;

/// The interface of a run to its lights, textures, plugins and messages.
pub(crate) struct Surroundings<'a> {
    /// The lights, in the order in which they were given.
    pub(crate) lights: &'a [Group],
    /// The texture files.
    pub(crate) textures: &'a TextureCache,
    /// The executor of the lights.
    pub(crate) executor: Executor,
    /// The grid that is being shaded.
    pub(crate) grid: Option<Grid>,
    /// The finder of functions in C++, and its search path.
    pub(crate) plugins: &'a (Plugins, SearchPath),
    /// The receiver of messages. The text of `printf` goes to `printed`.
    pub(crate) reporter: &'a Reporter,
    /// The output of `printf`.
    pub(crate) printed: String,
}

impl Spaces for Surroundings<'_> {
    fn to_common(&mut self, space: &str, _: usize) -> Option<Transform> {
        let known = ["shader", "object", "world", "common", "camera", "screen", "NDC", "raster"];
        known.contains(&space).then_some(Transform::IDENTITY)
    }

    fn unit_scale(&mut self, from: &str, to: &str) -> Option<f32> {
        // The unit of length of common space is a centimetre. The unit of time is a second.
        let known = |name: &str| {
            let length = |metres: f64| Some((metres, true));
            let time = |seconds: f64| Some((seconds, false));
            match name {
                "common" | "world" | "object" | "shader" | "camera" | "cm" => length(0.01),
                "um" => length(1e-6),
                "mm" => length(1e-3),
                "dm" => length(0.1),
                "m" => length(1.0),
                "km" => length(1e3),
                "in" => length(0.0254),
                "ft" => length(0.3048),
                "yd" => length(0.9144),
                "mi" => length(1609.344),
                "ms" => time(1e-3),
                "s" => time(1.0),
                "min" => time(60.0),
                "hr" => time(3600.0),
                "frame" | "frames" => time(1.0 / 24.0),
                _ => None,
            }
        };
        let (from, to) = (known(from)?, known(to)?);
        (from.1 == to.1).then_some((from.0 / to.0) as f32)
    }
}

impl Textures for Surroundings<'_> {
    fn texture(&mut self, query: &TextureQuery<'_>, out: &mut LookupResult) {
        lookups::texture(&mut self.textures.reader(), query, out);
    }

    fn texture3d(&mut self, query: &Texture3dQuery<'_>, out: &mut LookupResult) {
        lookups::texture3d(&mut self.textures.reader(), query, out);
    }

    fn environment(&mut self, query: &EnvironmentQuery<'_>, out: &mut LookupResult) {
        // All spaces are the same here.
        lookups::environment(&mut self.textures.reader(), query, None, false, out);
    }

    fn shadow(&mut self, query: &ShadowQuery<'_>, out: &mut Lanes3) {
        let seed = self.grid.as_ref().map_or(0, |grid| grid.seed);
        let bias = |lane: usize| query.options.bias.map_or(0.0, |b| b.get(lane).max(0.0));
        lookups::shadow(
            &mut self.textures.reader(),
            query,
            1.0,
            &|lane| Draw::alone(Sequence::new(hash::words(&[seed, lane]))),
            &bias,
            out,
        );
    }

    fn texture_info(&mut self, texture: &str, name: &str) -> Option<Param> {
        self.textures.info(texture, name)
    }
}

impl Lights for Surroundings<'_> {
    fn light_count(&mut self) -> usize {
        self.lights.len()
    }

    fn light_info(&mut self, index: usize) -> LightInfo {
        let light = &self.lights[index];
        LightInfo {
            ambient: !light.has_emit(),
            category: light.param_string("__category").unwrap_or_default(),
        }
    }

    fn light_asks(&mut self, index: usize) -> bool {
        [ShaderKind::Surface, ShaderKind::Volume].iter().any(|kind| self.lights[index].listens_to(*kind))
    }

    fn illuminate(&mut self, index: usize, query: &IlluminateQuery<'_>) -> Arc<LightResult> {
        let lights = self.lights;
        let Some(mut grid) = self.grid.take() else { return Arc::default() };
        let earlier = grid.messages.len();
        grid.messages.extend_from_slice(query.messages);
        let mut executor = std::mem::take(&mut self.executor);
        let result = executor.run_light(&lights[index], &grid, query, self);
        self.executor = executor;
        grid.messages.truncate(earlier);
        self.grid = Some(grid);
        Arc::new(result)
    }
}

impl Rays for Surroundings<'_> {}

impl Databases for Surroundings<'_> {}

impl Messages for Surroundings<'_> {
    fn say(&mut self, severity: Severity, text: &str) {
        if severity == Severity::Message {
            self.printed.push_str(text);
        } else {
            self.reporter.once(text, severity, &granita_base::Location::default(), text);
        }
    }
}

impl Recall for Surroundings<'_> {}

impl Host for Surroundings<'_> {
    fn shadeop(&mut self, text: &str) -> Result<Arc<dyn Shadeop>, String> {
        self.plugins.0.shadeop(text, &self.plugins.1)
    }

    fn attribute(&mut self, _: &str) -> Option<Param> {
        None
    }
}
