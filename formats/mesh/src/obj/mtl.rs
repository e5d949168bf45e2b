//! The material libraries of OBJ files.

use crate::emit::{self, Emit, color, float, string};
use crate::faults::Faults;
use crate::source::open_file;
use crate::text::{Lines, Words};
use granita_base::Files;
use granita_base::Params;
use granita_scene::{Call, Stop};
use std::collections::BTreeMap;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// The statements of a material for which the shader `mtlsurface` has a parameter.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Material {
    kd: [f32; 3],
    ks: [f32; 3],
    ke: [f32; 3],
    ns: f32,
    opacity: f32,
    map: Option<Map>,
}

/// An image that scales the diffuse colour.
#[derive(Clone, Debug, PartialEq)]
struct Map {
    path: PathBuf,
    clamp: bool,
    offset: [f32; 2],
    scale: [f32; 2],
}

impl Default for Material {
    fn default() -> Self {
        Self { kd: [0.8; 3], ks: [0.0; 3], ke: [0.0; 3], ns: 10.0, opacity: 1.0, map: None }
    }
}

impl Material {
    /// Makes it the material of the following shapes.
    pub(super) fn emit(&self, emit: &mut Emit<'_>, line: u32) -> Result<(), Stop> {
        emit.attribute(color("C", self.kd), line)?;
        emit.attribute(color("opacity", [self.opacity; 3]), line)?;
        // `specular ()` raises the cosine to the power 8 / roughness. OBJ files raise it to the power Ns.
        let mut params = vec![
            color("specularcolor", self.ks),
            float("roughness", 8.0 / self.ns.max(1.0)),
            color("emission", self.ke),
        ];
        if let Some(map) = &self.map {
            let name = emit::texture_path(&map.path);
            params.push(string("texturename", &name));
            params.push(string("wrap", if map.clamp { "clamp" } else { "periodic" }));
            params.push(float("texturesrgb", f32::from(u8::from(emit::is_screen_image(&name)))));
        }
        let shader = Call::Shader {
            usage: "surface".into(),
            name: Some("mtlsurface".into()),
            layer: None,
            params: Params(params),
        };
        emit.call(shader, line)
    }

    /// Returns `s` and `t` of texture coordinates. They are scaled and translated by the map, and measured from the
    /// upper edge.
    pub(super) fn st(&self, [u, v]: [f32; 2]) -> [f32; 2] {
        match &self.map {
            Some(map) => [u * map.scale[0] + map.offset[0], 1.0 - (v * map.scale[1] + map.offset[1])],
            None => [u, 1.0 - v],
        }
    }
}

/// Reads a library into `materials`. Its errors are reported with its own name and lines.
pub(super) fn read(
    path: &Path,
    files: &Files,
    materials: &mut BTreeMap<Vec<u8>, Material>,
    reporter: &granita_base::Reporter,
) -> io::Result<()> {
    let (file, _) = open_file(path, files)?;
    reporter.file_read(path);
    let name: Arc<str> = path.to_string_lossy().into();
    let mut faults = Faults::new(reporter, name);
    let mut lines = Lines::new(file, true);
    let mut current: Option<(Vec<u8>, Material)> = None;
    while let Some((line, text)) = lines.next_line()? {
        let mut words = Words(text);
        let Some(keyword) = words.word() else { continue };
        if keyword == b"newmtl" {
            if let Some((name, material)) = current.take() {
                materials.insert(name, material);
            }
            current = Some((words.rest().into_bytes(), Material::default()));
            continue;
        }
        let Some((_, material)) = &mut current else { continue };
        if let Err(why) = statement(material, keyword, words, path) {
            faults
                .error("statement", line, || format!("{} {why}: ignored", String::from_utf8_lossy(keyword)));
        }
    }
    if let Some((name, material)) = current {
        materials.insert(name, material);
    }
    Ok(())
}

fn statement(m: &mut Material, keyword: &[u8], words: Words<'_>, path: &Path) -> Result<(), &'static str> {
    match keyword {
        b"Kd" => m.kd = colour(words)?,
        b"Ks" => m.ks = colour(words)?,
        b"Ke" => m.ke = colour(words)?,
        b"Ns" => m.ns = number(words)?.clamp(1.0, 1.0e6),
        b"d" => {
            // "d -halo factor" dims by the angle, for which there is no parameter.
            let mut after = words;
            let words = if after.word() == Some(b"-halo") { after } else { words };
            m.opacity = number(words)?.clamp(0.0, 1.0);
        }
        b"Tr" => m.opacity = (1.0 - number(words)?).clamp(0.0, 1.0),
        b"map_Kd" => m.map = Some(map(words, path)?),
        // All others (ambient light, bump maps, illumination models ...) have no equivalent here.
        _ => {}
    }
    Ok(())
}

fn number(mut words: Words<'_>) -> Result<f32, &'static str> {
    words.float().filter(|x| x.is_finite()).ok_or("without a number")
}

fn colour(words: Words<'_>) -> Result<[f32; 3], &'static str> {
    let mut after = words;
    match after.word() {
        Some(b"spectral") => return Err("as a spectral curve is not supported"),
        Some(b"xyz") => return Err("in CIE XYZ is not supported"),
        _ => {}
    }
    let mut words = words;
    let red = words.float().filter(|x| x.is_finite()).ok_or("without a number")?;
    // One number replaces missing ones.
    let green = words.float().unwrap_or(red);
    let blue = words.float().unwrap_or(green);
    if green.is_finite() && blue.is_finite() { Ok([red, green, blue]) } else { Err("without three numbers") }
}

/// Reads an image, which has options and then a name. The name may contain blanks.
fn map(mut words: Words<'_>, library: &Path) -> Result<Map, &'static str> {
    let mut map = Map { path: PathBuf::new(), clamp: false, offset: [0.0; 2], scale: [1.0; 2] };
    loop {
        let mut after = words;
        let Some(option) = after.word().filter(|w| w.starts_with(b"-") && w.len() > 1) else { break };
        words = after;
        match option {
            b"-clamp" => map.clamp = words.word() == Some(b"on"),
            b"-o" | b"-s" | b"-t" => {
                let mut values = [0.0; 3];
                let mut n = 0;
                while n < 3 {
                    let mut after = words;
                    let Some(value) = after.float().filter(|x| x.is_finite()) else { break };
                    values[n] = value;
                    n += 1;
                    words = after;
                }
                match option {
                    b"-o" => map.offset = [values[0], values[1]],
                    b"-s" if n > 1 => map.scale = [values[0], values[1]],
                    b"-s" if n > 0 => map.scale = [values[0], 1.0],
                    _ => {}
                }
            }
            b"-mm" => {
                words.word();
                words.word();
            }
            _ => {
                words.word();
            }
        }
    }
    let name = words.rest().replace('\\', "/");
    if name.is_empty() {
        return Err("without a file name");
    }
    map.path = library.parent().unwrap_or(Path::new("")).join(name);
    Ok(map)
}

#[cfg(test)]
mod tests {
    use super::*;
    use granita_base::Reporter;

    fn parse(text: &str) -> (BTreeMap<Vec<u8>, Material>, Vec<String>) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("m.mtl");
        std::fs::write(&path, text).unwrap();
        let (reporter, kept) = Reporter::collecting();
        let mut all = BTreeMap::new();
        read(&path, &Files::default(), &mut all, &reporter).unwrap();
        let prefix = format!("{}", path.display());
        let kept = kept.lock().iter().map(|m| m.to_string().replace(&prefix, "m.mtl")).collect();
        (all, kept)
    }

    #[test]
    fn statements() {
        let text = "Kd 1 1 1\nnewmtl two words \nKd 0.5\nKs 0.1 0.2 0.3\nNs 50\nTr 0.25\nKe 1 0 0\nillum 2\n\
                    map_Kd -clamp on -o 0.5 0 0 -s 2 3 -mm 0 1 some dir\\wood 1.png\nnewmtl b\nd -halo 0.5\n";
        let (all, messages) = parse(text);
        assert!(messages.is_empty(), "{messages:?}");
        let a = &all[&b"two words"[..]];
        assert_eq!((a.kd, a.ks, a.ke), ([0.5; 3], [0.1, 0.2, 0.3], [1.0, 0.0, 0.0]));
        assert_eq!((a.ns, a.opacity), (50.0, 0.75));
        let map = a.map.as_ref().unwrap();
        assert!(map.path.ends_with("some dir/wood 1.png") && map.clamp);
        assert_eq!((map.offset, map.scale), ([0.5, 0.0], [2.0, 3.0]));
        assert_eq!(all[&b"b"[..]].opacity, 0.5);
    }

    #[test]
    fn mistakes_are_told_with_their_line() {
        let (all, messages) = parse("newmtl a\nKd red\nKs\nKd 0.1 0.2 0.3\nmap_Kd -o 1\n");
        assert_eq!(all[&b"a"[..]].kd, [0.1, 0.2, 0.3]);
        assert_eq!(messages, ["m.mtl:2: error: Kd without a number: ignored; 2 more of this kind"]);
    }
}
