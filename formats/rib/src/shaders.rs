//! Shaders and lights.

use crate::declare::Given;
use crate::options::string;
use crate::reader::{Done, Fault, Reader, handle, plain};
use crate::request::Request;
use granita_base::{BaseType, Params};
use granita_scene::Call;
use std::sync::Arc;

impl Reader<'_> {
    /// Executes requests for shaders and lights. Returns `None` for other requests.
    pub(crate) fn shader_request(&mut self, request: &Request) -> Option<Done> {
        Some(match request.name.as_str() {
            "Surface" => self.shader(request, "surface"),
            "Displacement" => self.shader(request, "displacement"),
            "Atmosphere" => self.shader(request, "volume"),
            "LightSource" => self.light(request, false),
            "AreaLightSource" => self.light(request, true),
            "Illuminate" => {
                let id = handle(request.args.first());
                let on = request.args.get(1).and_then(|a| a.ints()?.first().copied());
                match (id, on) {
                    (Some(handle), Some(on)) => {
                        let uses = self.lights.get(&handle).copied().unwrap_or(1);
                        self.emit(Call::LightSwitch { id: light_id(&handle, uses), on: on != 0 })
                    }
                    _ => Err(Fault::Mistake("needs a light and 0 or 1".to_owned())),
                }
            }
            _ => return None,
        })
    }

    fn shader(&mut self, request: &Request, usage: &str) -> Done {
        let name = string(request, 0)?;
        let given = self.params(request, 1);
        let name = shader_name(&name);
        let params = shader_params(&name, &given);
        let name = (!name.is_empty() && &*name != "null").then_some(name);
        self.emit(Call::Shader { usage: usage.into(), name, layer: None, params })
    }

    fn light(&mut self, request: &Request, area: bool) -> Done {
        let name = shader_name(&string(request, 0)?);
        let id = handle(request.args.get(1)).ok_or_else(|| "no light handle".to_owned())?;
        if area && (name.is_empty() || &*name == "null") {
            // This request ends an area light.
            return Ok(());
        }
        let uses = self.lights.entry(id.clone()).or_insert(0);
        *uses += 1;
        let id = light_id(&id, *uses);
        let given = self.params(request, 2);
        let mut params = shader_params(&name, &given);
        if area {
            self.area_lights += 1;
            let set = format!("arealight{}", self.area_lights);
            params.set(plain("geometry", BaseType::String, set.as_str()));
            self.emit(Call::Light { id, shader: Some(name), layer: None, params })?;
            return self.add_to_set(&set);
        }
        self.emit(Call::Light { id, shader: Some(name), layer: None, params })
    }
}

/// Returns the name of the light for a handle after this number of uses. In the scene interface, a name that is used
/// again replaces its light. In RIB the first light stays.
fn light_id(handle: &Arc<str>, uses: usize) -> Arc<str> {
    if uses < 2 { handle.clone() } else { format!("{handle} ({uses})").into() }
}

/// Returns the name without the extension of compiled shaders of other renderers.
fn shader_name(name: &str) -> Arc<str> {
    let endings = [".sl", ".slo", ".slx", ".slc", ".sdl", ".oso"];
    endings.iter().find_map(|e| name.strip_suffix(e)).unwrap_or(name).into()
}

/// Returns the parameters, with the names that the bundled shaders have for them.
fn shader_params(shader: &str, given: &[Given]) -> Params {
    given
        .iter()
        .map(|g| {
            let mut param = g.constant();
            if shader == "shinymetal" && &*param.name == "texturename" {
                param.name = "envname".into();
            }
            if param.ty.array.is_none() {
                // One value is used, for any declared class.
                param.data = first_item(&param.data, param.ty.base.components());
            }
            param
        })
        .collect()
}

fn first_item(data: &granita_base::ParamData, n: usize) -> granita_base::ParamData {
    use granita_base::ParamData;
    match data {
        ParamData::Float(v) if v.len() > n => ParamData::Float(v[..n].into()),
        ParamData::Int(v) if v.len() > n => ParamData::Int(v[..n].into()),
        ParamData::String(v) if v.len() > n => ParamData::String(v[..n].into()),
        data => data.clone(),
    }
}
