//! Links groups again for primitive variables whose length differs from the parameters that they replace.

use super::given::same_type;
use super::layer::Layer;
use super::source::{ConnectionSource, LayerSource, LinkOptions};
use crate::Grid;
use granita_base::Params;
use granita_gsl::ValidModule;
use granita_gsl::ir::ValueType;
use parking_lot::Mutex;
use std::collections::BTreeMap;
use std::sync::Arc;

/// The largest number of kept variants. Further lengths are linked each time.
const MAX_VARIANTS: usize = 64;

/// Lengths by layer and parameter.
pub(super) type Lengths = BTreeMap<(usize, usize), u32>;

/// The sources of a group `G` with variable-length parameters, and its variants.
#[derive(Debug)]
pub(super) struct Relink<G> {
    layers: Vec<(ValidModule, Params, Option<String>)>,
    connections: Vec<[String; 4]>,
    pub(super) options: LinkOptions,
    open: Vec<Open>,
    variants: Mutex<BTreeMap<Lengths, Arc<G>>>,
}

/// A parameter of variable length, and its length.
#[derive(Debug)]
struct Open {
    at: (usize, usize),
    name: Arc<str>,
    value: ValueType,
    length: u32,
}

impl<G> Relink<G> {
    /// Makes the data for layers that were just linked; `None` when all their lengths are fixed.
    pub(super) fn of(
        linked: &[Layer],
        layers: &[LayerSource<'_>],
        connections: &[ConnectionSource<'_>],
        options: LinkOptions,
    ) -> Option<Self> {
        let mut open = Vec::new();
        for (k, layer) in linked.iter().enumerate() {
            for (p, plan) in layer.params.iter().enumerate() {
                let ty = layer.module.symbol(plan.symbol).ty;
                if ty.open && ty.array.is_some() {
                    let length = layer.places[plan.symbol.0 as usize].elements;
                    open.push(Open { at: (k, p), name: plan.name.clone(), value: ty.value, length });
                }
            }
        }
        let text = str::to_owned;
        (!open.is_empty()).then(|| Self {
            layers: layers.iter().map(|l| (l.module.clone(), l.params.clone(), l.name.map(text))).collect(),
            connections: connections
                .iter()
                .map(|c| [c.source_layer, c.source, c.target_layer, c.target].map(text))
                .collect(),
            options,
            open,
            variants: Mutex::default(),
        })
    }

    /// Returns the variant for a grid, which `link` makes on first use. Returns `None` when the group itself fits,
    /// or no other one can be linked.
    pub(super) fn variant(
        &self,
        grid: &Grid,
        link: impl FnOnce(&[LayerSource<'_>], &[ConnectionSource<'_>], &Lengths) -> Option<G>,
    ) -> Option<Arc<G>> {
        let mut lengths = Lengths::new();
        for open in &self.open {
            let Some(primvar) = grid.primvars.iter().find(|p| p.name == open.name) else { continue };
            let Some(n) = primvar.ty.array.filter(|n| *n > 0 && *n != open.length) else { continue };
            if same_type(primvar.ty, open.value, Some(n)) {
                lengths.insert(open.at, n);
            }
        }
        if lengths.is_empty() {
            return None;
        }
        let known = |map: &BTreeMap<Lengths, Arc<G>>| map.get(&lengths).cloned();
        if let Some(group) = known(&self.variants.lock()) {
            return Some(group);
        }
        let layers: Vec<LayerSource<'_>> = self
            .layers
            .iter()
            .map(|(module, params, name)| LayerSource {
                module: module.clone(),
                params,
                name: name.as_deref(),
            })
            .collect();
        let connections: Vec<ConnectionSource<'_>> = self
            .connections
            .iter()
            .map(|[source_layer, source, target_layer, target]| ConnectionSource {
                source_layer,
                source,
                target_layer,
                target,
            })
            .collect();
        let group = Arc::new(link(&layers, &connections, &lengths)?);
        let mut variants = self.variants.lock();
        if variants.len() >= MAX_VARIANTS {
            variants.clear();
        }
        variants.insert(lengths, group.clone());
        Some(group)
    }
}
