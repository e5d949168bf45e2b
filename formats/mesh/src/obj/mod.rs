//! Wavefront OBJ. Polygons, lines and points become calls, with the materials of MTL libraries.
//!
//! The tables of vertices, texture coordinates and normals are kept for the whole file, because any face may refer to
//! them. Faces are kept up to the next change of object, group or material, and become one mesh.

mod group;
mod mtl;
mod table;

use crate::emit::{Emit, object_name};
use crate::faults::{Faults, of_object};
use crate::source::{io_error, open};
use crate::text::{Lines, Words};
use granita_base::Reporter;
use granita_scene::{Call, Generator, GeneratorError, GeneratorSource, SceneSink};
use group::{Group, Place, Scratch};
use mtl::Material;
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use std::sync::Arc;
use table::{Corner, Table, Wrong};

/// The largest number of corners of a mesh. A mesh with more corners is emitted before its group ends, because indices
/// have 31 bits.
const MOST_CORNERS: usize = 1 << 28;

/// Reads `.obj` files.
#[derive(Clone, Copy, Debug, Default)]
pub struct Obj;

impl Generator for Obj {
    fn name(&self) -> &'static str {
        "obj"
    }

    fn extensions(&self) -> &'static [&'static str] {
        &["obj"]
    }

    fn run(
        &self,
        source: &GeneratorSource,
        sink: &mut dyn SceneSink,
        reporter: &Reporter,
    ) -> Result<(), GeneratorError> {
        let opened = open(source)?;
        let file = opened.name;
        let emit = Emit::new(sink, file.clone()).smoothing();
        let wants_materials = emit.wants("materials");
        let reader = Reader {
            emit,
            reporter,
            faults: Faults::new(reporter, file.clone()),
            folder: source.folder(),
            files: source.files(),
            wants_materials,
            table: Table::default(),
            group: Group::default(),
            scratch: Scratch::default(),
            corners: Vec::new(),
            smoothing: 0,
            object: String::new(),
            groups: String::new(),
            materials: BTreeMap::new(),
            libraries: BTreeSet::new(),
            material: None,
            is_empty: true,
        };
        reader.run(&file, Lines::new(opened.stream, true))
    }
}

struct Reader<'a> {
    emit: Emit<'a>,
    reporter: &'a Reporter,
    faults: Faults<'a>,
    folder: Option<&'a Path>,
    files: &'a granita_base::Files,
    wants_materials: bool,
    table: Table,
    group: Group,
    scratch: Scratch,
    corners: Vec<Corner>,
    smoothing: u32,
    object: String,
    groups: String,
    materials: BTreeMap<Vec<u8>, Material>,
    libraries: BTreeSet<String>,
    material: Option<Material>,
    /// True before the first face, line or point.
    is_empty: bool,
}

impl Reader<'_> {
    fn run<R: std::io::Read>(mut self, file: &Arc<str>, mut lines: Lines<R>) -> Result<(), GeneratorError> {
        loop {
            match lines.next_line() {
                Ok(Some((line, text))) => {
                    let mut words = Words(text);
                    match words.word() {
                        Some(keyword @ (b"v" | b"vn" | b"vt" | b"f" | b"l" | b"p")) => {
                            self.element(keyword, words, line)?;
                        }
                        Some(keyword) => self.other(keyword, words, line)?,
                        None => {}
                    }
                }
                Ok(None) => {
                    if self.is_empty {
                        let what = || "no faces, lines or points: nothing to draw".into();
                        self.faults.warning("empty", 0, what);
                    }
                    return self.flush();
                }
                Err(error) => {
                    self.flush()?;
                    return Err(io_error(file, error));
                }
            }
        }
    }

    /// Returns the name of the current object, which is `object`, `group` or `object/group`.
    fn name(&self) -> String {
        match (self.object.is_empty(), self.groups.is_empty()) {
            (_, true) => self.object.clone(),
            (true, false) => self.groups.clone(),
            (false, false) => format!("{}/{}", self.object, self.groups),
        }
    }

    /// Emits the collected elements.
    fn flush(&mut self) -> Result<(), GeneratorError> {
        if self.group.is_empty() {
            return Ok(());
        }
        let line = self.group.line();
        let name = self.name();
        let own_state = !name.is_empty() || self.material.is_some();
        if own_state {
            self.emit.call(Call::PushAttributes, line)?;
        }
        if !name.is_empty() {
            self.emit.attribute(object_name(&name), line)?;
        }
        if let Some(material) = &self.material {
            material.emit(&mut self.emit, line)?;
        }
        let place = Place { table: &self.table, material: self.material.as_ref(), object: &name };
        self.group.flush(place, &mut self.scratch, &mut self.faults, &mut self.emit)?;
        if own_state {
            self.emit.call(Call::PopAttributes, line)?;
        }
        Ok(())
    }

    /// Reads entries of the tables, and elements that refer to them.
    fn element(&mut self, keyword: &[u8], words: Words<'_>, line: u32) -> Result<(), GeneratorError> {
        let good = match keyword {
            b"v" => self.table.vertex(words),
            b"vn" => self.table.normal(words),
            b"vt" => self.table.texcoord(words),
            _ => {
                self.is_empty = false;
                return self.indexed(keyword, words, line);
            }
        };
        if !good {
            let (what, kind) = match keyword {
                b"v" => ("vertex", "v"),
                b"vn" => ("normal", "vn"),
                _ => ("texture coordinate", "vt"),
            };
            self.faults.error(kind, line, || {
                format!("{what} with fewer numbers than it needs, or none that are finite")
            });
        }
        Ok(())
    }

    /// Reads faces, lines and points.
    fn indexed(&mut self, keyword: &[u8], mut words: Words<'_>, line: u32) -> Result<(), GeneratorError> {
        let (what, least) = match keyword {
            b"f" => ("face", 3),
            b"l" => ("line", 2),
            _ => ("point", 1),
        };
        self.corners.clear();
        while let Some(word) = words.word() {
            match self.table.corner(word) {
                Ok(corner) => self.corners.push(corner),
                Err(wrong) => {
                    let object = of_object(&self.name());
                    let vertices = self.table.positions.len();
                    let text = || match wrong {
                        Wrong::Syntax => {
                            let word = String::from_utf8_lossy(&word[..word.len().min(40)]).into_owned();
                            format!("{what} with \"{word}\" for a corner{object}: left out")
                        }
                        Wrong::Index(i) => {
                            format!(
                                "{what} refers to number {i}, with {vertices} vertices so far{object}: left out"
                            )
                        }
                    };
                    match wrong {
                        Wrong::Syntax => self.faults.error("corner", line, text),
                        Wrong::Index(_) => self.faults.error("index", line, text),
                    }
                    return Ok(());
                }
            }
        }
        if self.corners.len() < least {
            let (n, object) = (self.corners.len(), of_object(&self.name()));
            self.faults.error("few corners", line, || {
                format!("{what} with {n} of at least {least} vertices{object}: left out")
            });
            return Ok(());
        }
        if self.group.corner_count().saturating_add(self.corners.len()) > MOST_CORNERS {
            self.flush()?;
        }
        match keyword {
            b"f" => self.group.face(&self.corners, line, self.smoothing),
            b"l" => self.group.polyline(&self.corners, line),
            _ => self.group.points(&self.corners, line),
        }
        Ok(())
    }

    fn other(&mut self, keyword: &[u8], mut words: Words<'_>, line: u32) -> Result<(), GeneratorError> {
        if keyword.starts_with(b"#") {
            return Ok(());
        }
        match keyword {
            b"o" => {
                self.flush()?;
                self.object = words.rest();
                // Groups belong to the object that they follow.
                self.groups.clear();
            }
            b"g" => {
                let groups = words.rest();
                if groups != self.groups {
                    self.flush()?;
                    self.groups = groups;
                }
            }
            b"s" => {
                // "off" and any word that is not a number mean no smoothing.
                let number = words.word().and_then(|w| std::str::from_utf8(w).ok()?.parse().ok());
                self.smoothing = number.unwrap_or(0);
            }
            b"mtllib" if self.wants_materials => self.library(words, line),
            b"usemtl" if self.wants_materials => {
                let name = words.rest();
                let material = self.materials.get(name.as_bytes());
                // Some exporters write the material before every face.
                if material != self.material.as_ref() {
                    let material = material.cloned();
                    self.flush()?;
                    self.material = material;
                }
                // Libraries that cannot be read were reported already.
                if self.material.is_none() && !self.materials.is_empty() {
                    self.faults.warning("material", line, || {
                        format!("no material \"{name}\" in the libraries: the current attributes are used")
                    });
                }
            }
            b"mtllib" | b"usemtl" => {}
            b"curv" | b"curv2" | b"surf" => {
                let word = String::from_utf8_lossy(keyword).into_owned();
                self.faults.warning("free-form", line, || {
                    format!("free-form geometry (\"{word}\") is not supported: left out")
                });
            }
            b"call" | b"csh" => {
                let word = String::from_utf8_lossy(keyword).into_owned();
                self.faults.warning("call", line, || format!("\"{word}\" is not supported: ignored"));
            }
            // These statements belong to free-form geometry or to other renderers, or have no effect.
            b"vp" | b"cstype" | b"deg" | b"bmat" | b"step" | b"parm" | b"trim" | b"hole" | b"scrv"
            | b"sp" | b"end" | b"con" | b"mg" | b"bevel" | b"c_interp" | b"d_interp" | b"lod"
            | b"shadow_obj" | b"trace_obj" | b"ctech" | b"stech" | b"maplib" | b"usemap" | b"bzp"
            | b"bsp" | b"cdc" | b"cdp" | b"res" => {}
            _ => {
                let word = String::from_utf8_lossy(&keyword[..keyword.len().min(40)]).into_owned();
                self.faults.warning("statement", line, || format!("unknown statement \"{word}\": ignored"));
            }
        }
        Ok(())
    }

    /// Reads `mtllib`, which has one name that may contain blanks, or several names without blanks.
    fn library(&mut self, mut words: Words<'_>, line: u32) {
        let Some(folder) = self.folder else {
            let text = || "materials are looked for beside the file, and there is no file".to_owned();
            return self.faults.warning("no folder", line, text);
        };
        let place = |name: &str| folder.join(name.replace('\\', "/"));
        let whole = words.rest();
        let mut names = Vec::new();
        if self.files.is_file(&place(&whole)) {
            names.push(whole);
        } else {
            while let Some(word) = words.word() {
                names.push(String::from_utf8_lossy(word).into_owned());
            }
        }
        for name in names {
            if !self.libraries.insert(name.clone()) {
                continue;
            }
            let path = place(&name);
            if let Err(error) = mtl::read(&path, self.files, &mut self.materials, self.reporter) {
                self.faults.error("library", line, || {
                    format!("cannot read the materials in {}: {error}", path.display())
                });
            }
        }
    }
}

#[cfg(test)]
mod tests;
