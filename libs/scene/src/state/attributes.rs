//! `Attribute` and `GetAttribute` (reference 2.4), by the attribute table.

use super::current::{Edit, orientation, string};
use super::transforms::hint;
use super::{Phase, State};
use crate::attribute::{AttributeRow, Known, Scope, TABLE, attr, attribute_default, attribute_row, known};
use granita_base::{BaseType, Location, Param, ParamData, ParamType, Severity, suggestion};
use std::collections::BTreeSet;
use std::sync::Arc;

/// Returns the parameter with its values converted to the type of `row`, or a description of the error.
pub(super) fn convert(param: &Param, row: &AttributeRow) -> Result<Param, String> {
    Ok(Param { name: row.name.into(), ty: row.ty, data: converted(param, row)? })
}

/// Returns the values converted to the type of `row`, or a description of the error.
///
/// Any numeric type is converted to the declared one, if nothing is lost. Strings and numbers are not converted to
/// each other.
fn converted(param: &Param, row: &AttributeRow) -> Result<ParamData, String> {
    let declared = param.ty;
    let is_string = |base: BaseType| base == BaseType::String;
    if declared.base != BaseType::Unknown && is_string(declared.base) != is_string(row.ty.base) {
        let given = if is_string(declared.base) { "a string" } else { "a number" };
        return Err(format!("\"{}\" needs {}, not {given}", row.name, row.ty));
    }
    let whole = |v: &[f32]| v.iter().all(|f| f.fract() == 0.0);
    let data = match (row.ty.base, &param.data) {
        (BaseType::String, ParamData::String(_)) => Some(param.data.clone()),
        (BaseType::String, _) => None,
        (BaseType::Int, ParamData::Float(v)) if !whole(v) => None,
        (BaseType::Int, data) => data.to_ints().map(ParamData::Int),
        (_, data) => data.to_floats().map(ParamData::Float),
    };
    let Some(data) = data else {
        let given = match &param.data {
            ParamData::String(_) => "a string".to_owned(),
            _ if is_string(row.ty.base) => "a number".to_owned(),
            ParamData::Float(v) => {
                let bad = v.iter().find(|f| f.fract() != 0.0 || f.abs() >= 2_147_483_648.0);
                bad.map_or_else(|| "these numbers".to_owned(), ToString::to_string)
            }
            ParamData::Int(_) => "these numbers".to_owned(),
        };
        return Err(format!("\"{}\" needs {}, not {given}", row.name, row.ty));
    };
    let (got, mut want) = (data.len(), row.ty.width());
    if row.is_list() {
        want = got.max(1);
    }
    if got != want {
        return Err(format!("\"{}\" needs {} ({}), not {got}", row.name, values(want), row.ty));
    }
    // The values fit the attribute, so that the error is in the declaration.
    if declared.base != BaseType::Unknown && declared.width() != got {
        let declaration = param.declaration();
        return Err(format!("\"{declaration}\" declares {} and is given {got}", values(declared.width())));
    }
    if let ParamData::Float(v) = &data
        && v.iter().any(|x| x.is_nan())
    {
        return Err(format!("\"{}\" is not a number", row.name));
    }
    if let Some(word) = string_of(&data)
        && !row.words().is_empty()
        && !row.words().contains(&word)
    {
        let hint = hint(suggestion(word, row.words().iter().copied()));
        return Err(format!("\"{}\" cannot be \"{word}\"{hint}", row.name));
    }
    Ok(data)
}

/// Returns a number of values in words.
fn values(n: usize) -> String {
    format!("{n} value{}", if n == 1 { "" } else { "s" })
}

fn string_of(data: &ParamData) -> Option<&str> {
    match data {
        ParamData::String(v) => v.first().map(|s| &**s),
        _ => None,
    }
}

/// Returns the names that a misspelled attribute may stand for.
pub(super) fn attribute_names(scopes: &[Scope]) -> impl Iterator<Item = &'static str> {
    TABLE.iter().filter(move |r| scopes.contains(&r.scope)).map(|r| r.name)
}

/// Returns the attribute that a text such as `spatialquality=8,8` sets, checked. Values are separated by commas. The
/// name may be declared with a type, which attributes of users ("user:") need: `float user:age=3`.
///
/// # Errors
/// Returns a message for people when the text has no value, or does not fit the attribute.
pub fn attribute_from_text(text: &str) -> Result<Param, String> {
    let (declaration, value) = text.split_once('=').ok_or("expected NAME=VALUE")?;
    let (mut ty, name) = ParamType::parse(declaration.trim()).map_err(|error| error.to_string())?;
    let row = attribute_row(&name);
    if row.is_none() && !name.starts_with("user:") {
        let hint = hint(suggestion(&name, attribute_names(&[Scope::Camera, Scope::Global, Scope::Object])));
        return Err(format!("unknown attribute \"{name}\"{hint}"));
    }
    match row.map(|row| row.scope) {
        Some(Scope::ReadOnly) => return Err(format!("attribute \"{name}\" can be read, not set")),
        Some(Scope::Output | Scope::Writer) => return Err(format!("\"{name}\" is no attribute of scenes")),
        _ => {}
    }
    if ty.base == BaseType::Unknown {
        ty = row.map(|row| row.ty).ok_or(format!("\"{name}\" needs a type, as in \"float {name}\""))?;
    }
    let is_string = ty.base == BaseType::String;
    let data = if is_string && ty.width() == 1 {
        ParamData::from(value)
    } else if is_string {
        ParamData::String(value.split(',').map(Arc::from).collect())
    } else {
        let number =
            |word: &str| word.trim().parse::<f32>().map_err(|_| format!("\"{word}\" is not a number"));
        ParamData::Float(value.split(',').map(number).collect::<Result<_, _>>()?)
    };
    let param = Param { name: name.as_str().into(), ty, data };
    match row {
        Some(row) => convert(&param, row),
        None => typed(&param),
    }
}

impl State {
    /// Sets attributes that calls do not change. They come before the first call. Of several values the last one
    /// counts.
    pub fn fix_attributes(&mut self, params: &[Param]) {
        for param in params {
            self.fixed.remove(&param.name);
            self.set_attribute(param.clone(), &Location::default());
            self.fixed.insert(param.name.clone());
        }
    }

    /// Handles `Attribute`.
    pub(super) fn set_attribute(&mut self, param: Param, at: &Location) {
        if self.fixed.contains(&param.name) {
            return;
        }
        if param.name.starts_with("user:") {
            return self.set_user(param, at);
        }
        let Some(known) = known(&param.name) else {
            let settable = [Scope::Camera, Scope::Global, Scope::Object, Scope::Writer];
            let hint = hint(suggestion(&param.name, attribute_names(&settable)));
            let text = format!("unknown attribute \"{}\"{hint}", param.name);
            return self.report(Severity::Warning, at, "attribute", text);
        };
        if self.fixed.contains(&known.name) {
            return;
        }
        let row = known.row;
        let param = match converted(&param, row) {
            Ok(data) => Param { name: known.name.clone(), ty: row.ty, data },
            Err(text) => {
                let text = format!("Attribute: {text}");
                return self.report_object(Severity::Error, at, "attribute value", text);
            }
        };
        match row.scope {
            Scope::Object => self.set_object(known, param, at),
            Scope::Writer => self.set_writer(param),
            Scope::ReadOnly => {
                let text = format!("attribute \"{}\" can be read, not set", row.name);
                self.report(Severity::Error, at, "attribute", text);
            }
            Scope::Output => {
                let text = format!("\"{}\" is a parameter of Output, not an attribute", row.name);
                self.report(Severity::Warning, at, "attribute", text);
            }
            Scope::Camera | Scope::Global if self.phase == Phase::World => {
                let text = format!("attribute \"{}\" cannot be set after World", row.name);
                self.report(Severity::Error, at, "attribute", text);
            }
            Scope::Camera if self.in_rerender() => self.rerender_camera_attribute(row, param, at),
            Scope::Camera => {
                self.camera_values.insert(param.name.clone(), param);
            }
            Scope::Global => self.set_global(row, param, at),
        }
    }

    /// Stores a writer attribute for queries. "pyg:indent" is relative to its previous value (reference 4.3.12).
    fn set_writer(&mut self, mut param: Param) {
        let indent = attr::PYG_INDENT;
        if &*param.name == indent.name() {
            let old = indent.of(self.writer_values.get(indent.name()));
            param = indent.param(old.saturating_add(indent.of(Some(&param))).max(0));
        }
        self.writer_values.insert(param.name.clone(), param);
    }

    fn set_user(&mut self, param: Param, at: &Location) {
        if param.ty.base == BaseType::Unknown {
            let text = format!("attribute \"{}\" needs a type, as in \"float {}\"", param.name, param.name);
            return self.report(Severity::Error, at, "attribute", text);
        }
        match typed(&param) {
            Ok(param) => self.edit_sets(Edit::Attribute(&param.name, at), |set| {
                Arc::make_mut(&mut set.values).insert(param.name.clone(), param.clone());
            }),
            Err(text) => self.report_object(Severity::Error, at, "attribute", format!("Attribute: {text}")),
        }
    }

    fn set_object(&mut self, known: &Known, param: Param, at: &Location) {
        let row = known.row;
        let edit = if row.rerender { Edit::Allowed } else { Edit::Attribute(row.name, at) };
        match row.name {
            "geometryset" => {
                let change = string(&param).unwrap_or("").to_owned();
                let before = self.current.set.geometry_sets.clone();
                self.edit_sets(edit, |set| {
                    set.geometry_sets = changed_sets(&set.geometry_sets, &change);
                    let list = set.geometry_sets.join(",");
                    store(set, known, &Param { data: list.as_str().into(), ..param.clone() });
                });
                let after = &self.current.set.geometry_sets;
                for camera in self.cameras.iter().filter(|camera| before.contains(&camera.name)) {
                    if !after.contains(&camera.name) && !self.lost_sets.contains_key(&camera.name) {
                        self.lost_sets.insert(camera.name.clone(), (change.clone(), at.clone()));
                    }
                }
            }
            "orientation" => self.edit_sets(edit, |set| {
                let word = match string(&param) {
                    Some("reverse") => match orientation(set) {
                        "outside" => "inside",
                        "inside" => "outside",
                        "lh" => "rh",
                        _ => "lh",
                    },
                    word => word.unwrap_or("outside"),
                };
                store(set, known, &Param { data: word.into(), ..param.clone() });
            }),
            _ => {
                let negative =
                    |p: &Param| matches!(&p.data, ParamData::Float(v) if v.iter().any(|x| *x < 0.0));
                if negative(&param) && matches!(row.name, "shadingquality" | "displace:maxradius") {
                    let text = format!("Attribute: \"{}\" cannot be negative", row.name);
                    return self.report_object(Severity::Error, at, "attribute", text);
                }
                self.edit_sets(edit, |set| store(set, known, &param));
            }
        }
    }

    /// Sets a scene-wide attribute, checked and converted.
    fn set_global(&mut self, row: &AttributeRow, mut param: Param, at: &Location) {
        let previous = crate::attribute::lookup(self.globals.get(&param.name), &param.name);
        if param.name.starts_with("path:") {
            // "&" stands for the previous path.
            let old = previous.as_ref().and_then(string).unwrap_or("");
            let new: Vec<&str> = string(&param)
                .unwrap_or("")
                .split(':')
                .map(|part| if part == "&" { old } else { part })
                .collect();
            param.data = new.join(":").as_str().into();
        } else if param.name.starts_with("spatialdb:") {
            // Each call adds one database.
            let mut all: Vec<Arc<str>> = previous.as_ref().map(strings).unwrap_or_default();
            for name in strings(&param) {
                if !all.contains(&name) {
                    all.push(name);
                }
            }
            if all.len() > 1 {
                param.ty.array = u32::try_from(all.len()).ok();
            }
            param.data = ParamData::String(all.into());
        }
        if !self.may_be_global(row, &param, at) {
            return;
        }
        self.renderer.attribute(&param);
        self.globals.insert(param.name.clone(), param);
    }

    /// Handles `GetAttribute`. Returns `None` when there is no such attribute, or when it is not of the declared
    /// type.
    pub(super) fn get_attribute(&self, declaration: &str) -> Option<Param> {
        let (ty, name) = ParamType::parse(declaration).ok()?;
        let row = attribute_row(&name);
        let name = row.map_or(name.as_str(), |r| r.name);
        let found = match row.map(|r| r.scope) {
            None => self.current.set.values.get(name).cloned(),
            Some(Scope::Object) => crate::attribute::lookup(self.current.set.values.get(name), name),
            Some(Scope::Global) => crate::attribute::lookup(self.globals.get(name), name),
            Some(Scope::Writer) => crate::attribute::lookup(self.writer_values.get(name), name),
            Some(Scope::Camera) => self.camera_value(name),
            Some(Scope::Output) => attribute_default(name),
            Some(Scope::ReadOnly) => self.read_only(name),
        }?;
        let list = row.is_some_and(AttributeRow::is_list) && ty.array.is_none();
        let matches = ty.base == BaseType::Unknown
            || (ty.base == found.ty.base && (ty.array == found.ty.array || list));
        matches.then_some(found)
    }

    /// Returns the value for the next camera before World, and that of the first camera after World.
    fn camera_value(&self, name: &str) -> Option<Param> {
        let camera = self.cameras.first().filter(|_| self.phase != Phase::Options);
        let set = match camera {
            Some(camera) => camera.params.get(name).cloned(),
            None => self.camera_values.get(name).cloned(),
        };
        if name == "screen" && set.is_none() {
            // The value follows from the resolution unless it is set (reference 4.1).
            let number = |name| self.camera_value(name).and_then(|p| p.data.to_floats());
            let resolution = number("resolution")?;
            let row = attribute_row(name)?;
            let window = crate::camera::default_window([resolution[0], resolution[1]]);
            return Some(Param { name: row.name.into(), ty: row.ty, data: ParamData::from(&window[..]) });
        }
        set.or_else(|| attribute_default(name))
    }

    fn read_only(&self, name: &str) -> Option<Param> {
        if let Some(known) = self.renderer.query(name) {
            return Some(known);
        }
        let row = attribute_row(name)?;
        let data = match name {
            "transform" => {
                let shutter = self.cameras.first().map_or(0.0, |c| c.get(attr::SHUTTER)[0]);
                ParamData::from(&self.current.set.to_world.at(shutter).to_rows()[..])
            }
            "renderer:versionstring" | "renderer:version" => return version_attribute(name),
            "render:progress" if self.rendered => ParamData::from(1.0),
            "render:success" if self.rendered => ParamData::from(1),
            _ => return attribute_default(name),
        };
        Some(Param { name: row.name.into(), ty: row.ty, data })
    }
}

/// Returns the numbers of major version, minor version, release and patch.
fn version() -> [i32; 4] {
    let mut numbers = [0; 4];
    for (n, part) in numbers.iter_mut().zip(granita_base::VERSION.split('.')) {
        *n = part.parse().unwrap_or(0);
    }
    numbers
}

/// Returns "renderer:version" or "renderer:versionstring".
pub fn version_attribute(name: &str) -> Option<Param> {
    let row = attribute_row(name)?;
    let data = match row.name {
        "renderer:versionstring" => ParamData::from(&*version().map(|n| n.to_string()).join(".")),
        "renderer:version" => ParamData::from(&version()[..]),
        _ => return None,
    };
    Some(Param { name: row.name.into(), ty: row.ty, data })
}

/// Stores a value in the set, or removes the entry when the value is the default.
fn store(set: &mut crate::AttributeSet, known: &Known, value: &Param) {
    let name = known.row.name;
    let old = set.values.get(name);
    if known.default.as_ref().is_some_and(|d| d.data == value.data) {
        if old.is_some() {
            Arc::make_mut(&mut set.values).remove(name);
        }
    } else if old != Some(value) {
        Arc::make_mut(&mut set.values).insert(value.name.clone(), value.clone());
    }
}

fn strings(p: &Param) -> Vec<Arc<str>> {
    match &p.data {
        ParamData::String(v) => v.to_vec(),
        _ => Vec::new(),
    }
}

/// Returns the list of geometry sets after "geometryset" was set to `change` (reference 4.4.3).
fn changed_sets(old: &[Arc<str>], change: &str) -> Arc<[Arc<str>]> {
    let parts = || change.split(',').map(str::trim).filter(|p| !p.is_empty());
    let replaces = parts().any(|p| !p.starts_with(['+', '-'])) || parts().next().is_none();
    let mut sets: BTreeSet<Arc<str>> = if replaces { BTreeSet::new() } else { old.iter().cloned().collect() };
    for part in parts() {
        match part.split_at(1) {
            ("-", name) => {
                sets.remove(name.trim());
            }
            ("+", name) => {
                sets.insert(name.trim().into());
            }
            _ => {
                sets.insert(part.into());
            }
        }
    }
    sets.into_iter().collect()
}

/// Returns a parameter whose data agree with its declared type: numbers are converted, strings are required where
/// they are declared, and the number of items is whole.
pub(super) fn typed(param: &Param) -> Result<Param, String> {
    let what = || format!("\"{}\"", param.declaration());
    let data = match (param.ty.base, &param.data) {
        (BaseType::Unknown, data) => data.clone(),
        (BaseType::String, ParamData::String(_)) => param.data.clone(),
        (BaseType::String, _) => return Err(format!("{} is given numbers", what())),
        (_, ParamData::String(_)) => return Err(format!("{} is given strings", what())),
        (BaseType::Int, ParamData::Float(v)) if v.iter().any(|f| f.is_finite() && f.fract() != 0.0) => {
            let bad = v.iter().find(|f| f.fract() != 0.0).copied().unwrap_or_default();
            return Err(format!("{} is given {bad}, which is not an integer", what()));
        }
        (BaseType::Int, _) => match param.data.to_ints() {
            Some(v) => ParamData::Int(v),
            None => return Err(format!("{} is given numbers that are not 32-bit integers", what())),
        },
        _ => ParamData::Float(param.data.to_floats().unwrap_or_default()),
    };
    let width = param.ty.width();
    let constant = param.ty.interp == granita_base::Interp::Constant && param.ty.base != BaseType::Unknown;
    if constant && data.len() != width {
        return Err(format!("{} needs {}, not {}", what(), values(width), data.len()));
    }
    if width == 0 || !data.len().is_multiple_of(width) {
        return Err(format!("{} is given {}, not a multiple of {width}", what(), values(data.len())));
    }
    Ok(Param { name: param.name.clone(), ty: param.ty, data })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn geometry_set_lists_are_replaced_or_changed() {
        let old: Vec<Arc<str>> = vec!["camera".into()];
        let names = |c: &str| changed_sets(&old, c).join(" ");
        assert_eq!(names("+reflections"), "camera reflections");
        assert_eq!(names("-camera"), "");
        assert_eq!(names("maincam"), "maincam");
        assert_eq!(names("b, a"), "a b");
        assert_eq!(names("+b,-camera,+a"), "a b");
        assert_eq!(names("x,+y"), "x y");
        assert_eq!(names(""), "");
    }

    #[test]
    fn attributes_are_read_from_texts() {
        let read = |text| attribute_from_text(text).unwrap();
        assert_eq!(
            read("spatialquality=8, 4"),
            Param::declared("int[2] spatialquality", &[8, 4][..]).unwrap()
        );
        assert_eq!(read("float shadingquality = 0.5"), Param::declared("float shadingquality", 0.5).unwrap());
        assert_eq!(read("path:input=a=b:&"), Param::declared("string path:input", "a=b:&").unwrap());
        assert_eq!(read("float[2] user:pair=1,2").data, ParamData::from(&[1.0, 2.0][..]));
        for (text, part) in [
            ("shadingquality", "NAME=VALUE"),
            ("shadingqualty=1", "did you mean \"shadingquality\"?"),
            ("shadingquality=x", "\"x\" is not a number"),
            ("spatialquality=3", "2 values"),
            ("spatialquality=1.5,2", "not 1.5"),
            ("user:age=3", "needs a type"),
            ("renderer:name=x", "can be read, not set"),
            ("bucketorder=round", "cannot be"),
            ("=3", ""),
            ("int[x] a=3", ""),
        ] {
            let what = attribute_from_text(text).unwrap_err();
            assert!(what.contains(part), "{text}: {what}");
        }
    }

    #[test]
    fn values_convert_to_the_declared_type_or_are_refused() {
        let row = attribute_row("resolution").unwrap();
        let ok = convert(&Param::declared("float[2] resolution", &[640.0, 480.0][..]).unwrap(), row).unwrap();
        assert_eq!(ok.data, ParamData::from(&[640, 480][..]));
        let lossy = Param::declared("float[2] resolution", &[640.5, 480.0][..]).unwrap();
        assert!(convert(&lossy, row).unwrap_err().contains("not 640.5"));
        let other = Param::declared("int resolution", &[640, 480][..]).unwrap();
        assert!(convert(&other, row).unwrap_err().contains("declares 1 value and is given 2"));
        let other = Param::declared("string[2] resolution", &[640, 480][..]).unwrap();
        assert!(convert(&other, row).unwrap_err().contains("needs int[2], not a string"));
        assert!(convert(&Param::declared("resolution", 640).unwrap(), row).unwrap_err().contains("2 values"));
        assert!(
            convert(&Param::declared("resolution", "a").unwrap(), row).unwrap_err().contains("not a string")
        );
        let fov = attribute_row("fov").unwrap();
        assert!(convert(&Param::declared("fov", f32::NAN).unwrap(), fov).is_err());
        let order = attribute_row("bucketorder").unwrap();
        let wrong = convert(&Param::declared("bucketorder", "spirla").unwrap(), order).unwrap_err();
        assert!(wrong.contains("did you mean \"spiral\"?"), "{wrong}");
    }

    #[test]
    fn parameters_of_wrong_lengths_are_refused() {
        let p = |d: &str, v: &[f32]| typed(&Param::declared(d, v).unwrap());
        assert!(p("vertex point P", &[0.0; 6]).is_ok());
        assert!(p("vertex point P", &[0.0; 7]).unwrap_err().contains("multiple of 3"));
        assert!(p("color c", &[0.0; 6]).unwrap_err().contains("needs 3 values, not 6"));
        assert!(p("string s", &[0.0]).is_err());
        assert!(p("float[0] s", &[]).is_err());
        assert!(p("anything", &[0.0; 5]).is_ok());
    }
}
