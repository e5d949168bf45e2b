//! The light sources of a frame. They are linked once and run for the grids that query them.

use crate::lighting::area::AreaLight;
use crate::memo::{Key, KeyHasher};
use crate::object::{LinkedShaders, Linker};
use granita_base::{Vec3, hash};
use granita_dicing::finite;
use granita_gsl::ir::ShaderKind;
use granita_scene::{AttributeSet, Light, ShaderUsage, attr};
use granita_shade::{Batch, IlluminateQuery, Lane3, Lanes3, LightInfo, LightResult};
use std::sync::Arc;

/// A light source, ready to run.
#[derive(Debug)]
pub(crate) struct LightState {
    /// Its `lightid`.
    pub(crate) name: Arc<str>,
    /// The seed of its random numbers. It is a hash of its name, which does not depend on other lights.
    pub(crate) seed: u32,
    /// Its shaders.
    pub(crate) shaders: LinkedShaders,
    /// The properties that are available without running it.
    pub(crate) info: LightInfo,
    /// True when it queries messages of the surface or volume shader.
    pub(crate) listens: bool,
    /// The attribute state of the `Light` call.
    pub(crate) attributes: Arc<AttributeSet>,
    /// "shadow:bias" of that state.
    pub(crate) shadow_bias: f32,
    /// The surface that it shines from, when it has an area.
    pub(crate) area: Option<AreaLight>,
    /// The number of directions that sample a broad solar light ("light:nsamples").
    pub(crate) samples: u32,
    /// True when its results are not kept for re-renders ("rerender:cachelights" 0).
    pub(crate) is_anew: bool,
}

impl LightState {
    /// Links a light. Returns `None` when its shader cannot be used, which is already reported. The light stays
    /// dark.
    pub(crate) fn new(light: &Light, linker: Linker<'_>) -> Option<Self> {
        let shaders = linker.link(&light.group, ShaderUsage::Light, &light.name)?;
        let info = LightInfo {
            ambient: !shaders.group.has_emit(),
            category: shaders.group.param_string("__category").unwrap_or_else(|| "".into()),
        };
        let geometry = shaders.group.param_string("geometry").filter(|set| !set.is_empty());
        Some(Self {
            name: light.name.clone(),
            seed: hash::words(&light.name.bytes().map(u32::from).collect::<Vec<_>>()),
            listens: [ShaderKind::Surface, ShaderKind::Volume].iter().any(|k| shaders.group.listens_to(*k)),
            shaders,
            info,
            attributes: light.attributes.clone(),
            shadow_bias: light.attributes.get(attr::SHADOW_BIAS).max(0.0),
            area: geometry.map(|set| AreaLight::new(set, light.attributes.get(attr::LIGHT_NSAMPLES))),
            samples: crate::lighting::area::samples(light.attributes.get(attr::LIGHT_NSAMPLES)),
            is_anew: !light.attributes.get(attr::RERENDER_CACHELIGHTS),
        })
    }
}

/// Replaces colours and directions that are not finite by darkness. Returns true when there was one in an active
/// lane.
pub(crate) fn mend(result: &mut LightResult, active: &[u32]) -> bool {
    let usable = |lanes: &Lanes3| lanes.xyz.iter().all(|c| finite::all_usable(c));
    let mut bad = false;
    for sample in &mut result.samples {
        if usable(&sample.cl) && usable(&sample.l) {
            continue;
        }
        // Inactive lanes hold undefined values.
        for lane in active.iter().map(|lane| *lane as usize) {
            let is_bad = |v: Vec3| finite::mended(v).is_some();
            if sample.lit.get(lane) == Some(&true)
                && (is_bad(sample.cl.get(lane)) || is_bad(sample.l.get(lane)))
            {
                bad = true;
                sample.lit[lane] = false;
                sample.cl.set(lane, Vec3::ZERO);
                sample.l.set(lane, Vec3::ZERO);
            }
        }
    }
    if let Some(ambient) = result.ambient.as_mut().filter(|ambient| !usable(ambient)) {
        for lane in active.iter().map(|lane| *lane as usize) {
            if let Some(mended) = finite::mended(ambient.get(lane)) {
                bad = true;
                ambient.set(lane, mended);
            }
        }
    }
    bad
}

/// A query, and the results of lights for it.
struct Remembered {
    active: Vec<u32>,
    ps: Lanes3,
    ns: Lanes3,
    in_front: bool,
    asks: bool,
    /// The hash of all of this, once it was needed.
    key: Option<Key>,
    results: Vec<(usize, Arc<LightResult>)>,
}

/// The results of lights within one run of a surface or volume shader. All lights of a loop get the same query, and
/// `diffuse` and `specular` of one shader often make the same one.
#[derive(Default)]
pub(crate) struct LightMemory {
    kept: Vec<Remembered>,
}

impl LightMemory {
    /// The largest number of different queries in one run. Beyond it the oldest is dropped.
    const MOST: usize = 16;

    /// Returns the kept result of the same query: the same positions and axes, to the bit, on at least its lanes.
    pub(crate) fn find(&self, light: usize, query: &IlluminateQuery<'_>) -> Option<Arc<LightResult>> {
        self.kept.iter().find_map(|kept| {
            let (_, result) = kept.results.iter().find(|(of, _)| *of == light)?;
            let same = kept.agrees(query) && is_subset(query.batch.active, &kept.active);
            same.then(|| result.clone())
        })
    }

    /// Keeps a result.
    pub(crate) fn keep(&mut self, light: usize, query: &IlluminateQuery<'_>, result: &Arc<LightResult>) {
        self.place(query).results.push((light, result.clone()));
    }

    /// Returns the hash of the lanes, positions and axes of a query, which lights share.
    pub(crate) fn key(&mut self, query: &IlluminateQuery<'_>) -> Key {
        *self.place(query).key.get_or_insert_with(|| {
            let batch = Batch { layer: 0, ..query.batch };
            let mut hasher = KeyHasher::default();
            hasher.batch(batch);
            hasher.lane3(query.ps, batch);
            hasher.lane3(query.ns, batch);
            hasher.word(u32::from(query.in_front) | u32::from(query.asks) << 1);
            hasher.finish()
        })
    }

    /// Returns the place of a query, which is made for a new one.
    fn place(&mut self, query: &IlluminateQuery<'_>) -> &mut Remembered {
        let active = query.batch.active;
        let at = self.kept.iter().position(|kept| kept.active == active && kept.agrees(query));
        let at = at.unwrap_or_else(|| {
            if self.kept.len() == Self::MOST {
                self.kept.remove(0);
            }
            self.kept.push(Remembered::new(query));
            self.kept.len() - 1
        });
        &mut self.kept[at]
    }
}

impl Remembered {
    fn new(query: &IlluminateQuery<'_>) -> Self {
        let copy = |lanes: &Lane3<'_>| {
            let mut own = Lanes3::zeros(query.batch.lanes);
            for &i in query.batch.active {
                own.set(i as usize, lanes.get(i as usize));
            }
            own
        };
        Self {
            active: query.batch.active.to_vec(),
            ps: copy(&query.ps),
            ns: copy(&query.ns),
            in_front: query.in_front,
            asks: query.asks,
            key: None,
            results: Vec::new(),
        }
    }

    /// True when the lanes of a query have the same values.
    fn agrees(&self, query: &IlluminateQuery<'_>) -> bool {
        (self.in_front, self.asks) == (query.in_front, query.asks)
            && same_on(&self.ps, &query.ps, query.batch)
            && same_on(&self.ns, &query.ns, query.batch)
    }
}

/// Compares to the bit, so that NaN equals itself and rounding does not matter.
fn same_on(kept: &Lanes3, asked: &Lane3<'_>, batch: Batch<'_>) -> bool {
    kept.xyz.iter().zip(&asked.xyz).all(|(kept, asked)| {
        let all = batch.active.len() == batch.lanes && asked.stride == 1;
        match asked.values.get(..batch.lanes).filter(|_| all) {
            // The lanes follow each other.
            Some(asked) => {
                bytemuck::cast_slice::<f32, u32>(&kept[..batch.lanes])
                    == bytemuck::cast_slice::<f32, u32>(asked)
            }
            None => {
                batch.active.iter().map(|i| *i as usize).all(|i| kept[i].to_bits() == asked.get(i).to_bits())
            }
        }
    })
}

/// True when all of `part` (increasing) are in `whole` (increasing).
fn is_subset(part: &[u32], whole: &[u32]) -> bool {
    let mut rest = whole.iter();
    part.iter().all(|p| rest.any(|w| w == p))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn subsets_of_lanes_are_recognised() {
        assert!(is_subset(&[], &[]) && is_subset(&[1, 3], &[0, 1, 2, 3]) && is_subset(&[2], &[2]));
        assert!(!is_subset(&[1], &[]) && !is_subset(&[1, 4], &[1, 2, 3]));
    }

    #[test]
    fn light_results_are_reused_for_the_same_query_only() {
        let ps = Lanes3::from_points(&[Vec3::X, Vec3::Y, Vec3::Z]);
        let mut ns = Lanes3::from_points(&[Vec3::ONE; 3]);
        let all = Batch { lanes: 3, active: &[0, 1, 2], layer: 0 };
        let some = Batch { lanes: 3, active: &[0, 2], layer: 0 };
        let mut memory = LightMemory::default();
        let result = Arc::new(LightResult::default());
        memory.keep(4, &IlluminateQuery::new(all, Lane3::over(&ps), Lane3::over(&ns)), &result);
        let ask = |memory: &LightMemory, light, batch, ns: &Lanes3| {
            memory.find(light, &IlluminateQuery::new(batch, Lane3::over(&ps), Lane3::over(ns))).is_some()
        };
        assert!(ask(&memory, 4, all, &ns) && ask(&memory, 4, some, &ns));
        assert!(!ask(&memory, 3, all, &ns));
        // A lane that is not active may differ.
        ns.set(1, Vec3::ZERO);
        assert!(ask(&memory, 4, some, &ns) && !ask(&memory, 4, all, &ns));
    }
}
