//! Meshes whose faces have their own attribute states (reference 2.8.2). There is one primitive for each state, in
//! which the faces of the other states are holes. Subdivision uses the whole mesh each time, so that the parts fit.

use super::State;
use super::current::flips_normals;
use super::transforms::hint;
use crate::{AttributeSet, ShapeKey};
use granita_base::{
    BaseType, Location, Param, ParamData, ParamType, Params, Severity, ShapeDesc, suggestion,
};
use std::sync::Arc;

/// The faces that share a state, and the parameters of the mesh with all other faces as holes.
pub(super) struct Part {
    pub(super) attributes: Arc<AttributeSet>,
    pub(super) keys: Vec<ShapeKey>,
}

impl State {
    /// Returns the parts of a mesh with "__attributes"; `None` for any other primitive.
    pub(super) fn face_parts(
        &mut self,
        shape: &ShapeDesc,
        keys: &[ShapeKey],
        at: &Location,
    ) -> Option<Vec<Part>> {
        let ShapeDesc::Mesh { nverts, .. } = shape else { return None };
        let faces = nverts.len();
        let params = &keys.first()?.params;
        let names = params.get("__attributes")?;
        let camera = self.shading_camera();
        let default = self.current.freeze(camera.as_ref());
        let owners = match owners(names, params.get("__attributesindex"), faces) {
            Ok(owners) => owners,
            Err(text) => {
                self.report_object(Severity::Error, at, "face attributes", format!("Mesh: {text}"));
                vec![None; faces]
            }
        };
        // The states in the order of their first faces. `None` is the state of the primitive itself.
        let mut states: Vec<Option<Arc<str>>> = Vec::new();
        let mut of_face = Vec::with_capacity(faces);
        for owner in owners {
            let owner = owner.filter(|name| {
                let known = self.saved.contains_key(name);
                if !known {
                    let hint = hint(suggestion(name, self.saved.keys().map(|k| &**k)));
                    let text = format!("Mesh: no attributes were saved as \"{name}\"{hint}");
                    self.report_object(Severity::Error, at, "face attributes", text);
                }
                known
            });
            let index = states.iter().position(|s| *s == owner).unwrap_or_else(|| {
                states.push(owner);
                states.len() - 1
            });
            of_face.push(index);
        }
        let holes = params.get("holes").and_then(|p| p.data.to_ints()).unwrap_or_default();
        let parts = states.iter().enumerate().map(|(i, state)| {
            let attributes = match state.as_ref().and_then(|name| self.saved.get(name)) {
                None => default.clone(),
                Some(saved) => {
                    let mut set = (*default).clone();
                    saved.apply(&mut set);
                    // The faces stay where the mesh is.
                    set.to_world = default.to_world.clone();
                    set.flip_normals = flips_normals(&set, camera.as_ref());
                    Arc::new(set)
                }
            };
            let mut all: Vec<i32> = holes.to_vec();
            all.extend((0..faces).filter(|f| of_face[*f] != i).map(|f| f as i32));
            all.sort_unstable();
            all.dedup();
            let keys = keys.iter().map(|k| ShapeKey { time: k.time, params: with_holes(&k.params, &all) });
            Part { attributes, keys: keys.collect() }
        });
        Some(parts.collect())
    }
}

/// Returns the name of each face's state.
fn owners(names: &Param, index: Option<&Param>, faces: usize) -> Result<Vec<Option<Arc<str>>>, String> {
    let ParamData::String(names) = &names.data else {
        return Err("\"__attributes\" needs strings".into());
    };
    let Some(index) = index else {
        if names.len() != faces {
            return Err(format!("{} values of \"__attributes\" for {faces} faces", names.len()));
        }
        return Ok(names.iter().cloned().map(Some).collect());
    };
    let index = index.data.to_ints().unwrap_or_default();
    if index.len() != faces {
        return Err(format!("{} values of \"__attributesindex\" for {faces} faces", index.len()));
    }
    let name = |i: &i32| usize::try_from(*i).ok().and_then(|i| names.get(i));
    if let Some(bad) = index.iter().find(|i| name(i).is_none()) {
        return Err(format!(
            "\"__attributesindex\" is {bad}, but there are {} attribute states",
            names.len()
        ));
    }
    Ok(index.iter().map(|i| name(i).cloned()).collect())
}

/// Returns the parameters without those that name states, and with these holes.
fn with_holes(params: &Params, holes: &[i32]) -> Params {
    let special = ["__attributes", "__attributesindex", "holes"];
    let mut all: Params = params.iter().filter(|p| !special.contains(&&*p.name)).cloned().collect();
    if !holes.is_empty() {
        let ty = ParamType::array(BaseType::Int, holes.len() as u32);
        all.set(Param { name: "holes".into(), ty, data: holes.into() });
    }
    all
}
