//! Requests that make textures, and sources that are read later.

use crate::options::{exactly, string};
use crate::reader::{Done, Fault, Reader};
use crate::request::Request;
use granita_base::{BaseType, Param, ParamData, ParamType, Params};
use granita_scene::Call;
use std::sync::Arc;

impl Reader<'_> {
    /// Executes `Make...`, `Procedural` and `Geometry`. Returns `None` for other requests.
    pub(crate) fn texture_request(&mut self, request: &Request) -> Option<Done> {
        Some(match request.name.as_str() {
            // A bump map is a texture of heights.
            "MakeTexture" | "MakeBump" => self.make(request, 1, 2, None),
            "MakeLatLongEnvironment" => self.make(request, 1, 0, Some("-envlatl")),
            "MakeCubeFaceEnvironment" => self.make(request, 6, 0, Some("-envcube")),
            "MakeShadow" => self.make(request, 1, 0, Some("-shadow")),
            "MakeCubeFaceShadow" => self.make(request, 6, 0, Some("-shadcube")),
            "Procedural" => self.procedural(request),
            "Geometry" => match string(request, 0) {
                Ok(name) if &*name == "teapot" => {
                    self.emit(Call::Input { command: "teapot.pyg".into(), bound: None })
                }
                Ok(name) => Err(Fault::Unsupported(format!("Geometry \"{name}\" is not supported"))),
                Err(fault) => Err(fault),
            },
            _ => return None,
        })
    }

    /// Runs `maketx`. The arguments are `images` images, a texture and `wraps` wrap modes.
    fn make(&mut self, request: &Request, images: usize, wraps: usize, mode: Option<&str>) -> Done {
        let mut words: Vec<Arc<str>> = vec!["maketx".into()];
        words.extend(mode.map(Arc::from));
        let texture = string(request, images)?;
        for at in 0..wraps {
            let wrap = string(request, images + 1 + at)?;
            let option = if at == 0 { "-smode" } else { "-tmode" };
            words.extend([option.into(), wrap]);
        }
        if mode == Some("-envcube") {
            let fov = request.args.get(7).and_then(|a| a.floats()?.first().copied());
            if let Some(fov) = fov.filter(|f| *f > 0.0) {
                words.extend(["-fov".into(), fov.to_string().into()]);
            }
        }
        for at in 0..images {
            words.push(string(request, at)?);
        }
        words.extend(["-o".into(), texture]);
        let ty = ParamType::array(BaseType::String, words.len() as u32);
        let argv = Param { name: "argv".into(), ty, data: ParamData::String(words.into()) };
        self.emit(Call::Command { name: "system".into(), params: Params(vec![argv]) })
    }

    fn procedural(&mut self, request: &Request) -> Done {
        let kind = string(request, 0)?;
        let kind = kind.trim_start_matches("Proc");
        let args = request.args.get(1).and_then(|a| a.strings()).ok_or_else(|| "no arguments".to_owned())?;
        let bound: Request =
            Request { args: request.args.get(2..).unwrap_or_default().to_vec(), ..request.clone() };
        // Without a bound, or with an infinite one, the source is read at once.
        let bound = exactly::<6>(&bound).ok().filter(|b| b.iter().all(|x| x.abs() < 1.0e30));
        let inherited = self.inherited();
        let command = match (kind, &args[..]) {
            // Requests of this file are in memory, so reading them later would save nothing.
            ("DelayedReadArchive" | "DelayedReadArchive2", [name, ..]) if self.archives.has(name) => {
                return self.kept_archive(name);
            }
            ("DelayedReadArchive" | "DelayedReadArchive2", [name, ..]) => {
                let Some(path) = self.find_archive(name) else {
                    return Err(Fault::Mistake(format!("cannot find \"{name}\"")));
                };
                let path = path.to_string_lossy().into_owned();
                if inherited.is_empty() {
                    format!("rib {path}")
                } else {
                    let quoted = path.replace('\\', "\\\\").replace('"', "\\\"");
                    format!("rib << {inherited}ReadArchive \"{quoted}\"")
                }
            }
            ("RunProgram", [program, data]) => {
                // The program reads the size on screen and its data from one line, and writes requests.
                let data = format!("1000000 {data}").replace('\'', "'\\''");
                format!("rib < printf '%s\\n' '{data}' | {program}")
            }
            ("DelayedReadArchive" | "DelayedReadArchive2" | "RunProgram", _) => {
                return Err(Fault::Mistake("wrong number of arguments".to_owned()));
            }
            (other, _) => return Err(Fault::Unsupported(format!("Procedural \"{other}\" is not supported"))),
        };
        self.emit(Call::Input { command: command.into(), bound })
    }
}
