//! Tests that every attribute of the reference's list is set, queried, saved, restored, reset and rejected correctly.
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test, with a line number")]

use granita_base::{BaseType, Location, Param, ParamData, ParamType, Params, Reporter};
use granita_scene::attribute::{AttributeRow, Scope, TABLE};
use granita_scene::{
    Call, FoundInput, FrameRenderer, InputPaths, Scene, SceneSink, State, Stop, attribute_row,
};
use parking_lot::Mutex;
use std::sync::Arc;

struct Nothing;

impl FrameRenderer for Nothing {
    fn render(&mut self, _: Arc<Scene>, _: Option<&str>) -> Result<(), Stop> {
        Ok(())
    }
    fn command(&mut self, _: &str, _: &Params, _: &Location) -> Result<bool, Stop> {
        Ok(true)
    }
    fn input(&mut self, _: &str, _: InputPaths<'_>, _: &Location) -> Result<Option<FoundInput>, Stop> {
        Ok(None)
    }
}

struct Run {
    state: State,
    said: Arc<Mutex<Vec<granita_base::report::Message>>>,
}

impl Run {
    fn new() -> Self {
        let (reporter, said) = Reporter::collecting();
        Self { state: State::new(Box::new(Nothing), reporter), said }
    }

    fn call(&mut self, call: Call) {
        self.state.call(call, &Location::default()).unwrap();
    }

    fn set(&mut self, param: Param) {
        self.call(Call::Attribute(param));
    }

    fn get(&self, row: &AttributeRow) -> Option<ParamData> {
        let found = self.state.attribute(&row.declaration())?;
        assert_eq!(&*found.name, row.name);
        assert_eq!(found.ty, row.ty, "{}", row.name);
        let by_name = self.state.attribute(row.name).map(|p| p.data);
        assert_eq!(by_name.as_ref(), Some(&found.data), "{} without a type", row.name);
        Some(found.data)
    }

    /// Returns the messages since the last call.
    fn said(&self) -> Vec<String> {
        let said = std::mem::take(&mut *self.said.lock());
        said.iter().map(ToString::to_string).collect()
    }
}

/// Returns the rows of the list: scope, type and name, default ("-" for none).
fn list() -> Vec<(&'static str, &'static AttributeRow, &'static str)> {
    let lines = include_str!("data/attributes.tsv").lines();
    let rows = lines.map(|line| {
        let mut columns = line.split('\t');
        let (scope, declaration) = (columns.next().unwrap(), columns.next().unwrap());
        let (ty, name) = ParamType::parse(declaration).unwrap();
        let row = attribute_row(&name).unwrap_or_else(|| panic!("no row for {name}"));
        assert_eq!(row.ty, ty, "{name}");
        (scope, row, columns.next().unwrap_or(""))
    });
    rows.collect()
}

/// Returns a value of the row's type that is not its default.
fn other(row: &AttributeRow) -> ParamData {
    if let Some(word) = row.words().get(1) {
        return (*word).into();
    }
    match row.ty.base {
        BaseType::String if !row.words().is_empty() => row.words()[0].into(),
        BaseType::String if row.name == "geometryset" => "camera,mirror".into(),
        BaseType::String => "something else".into(),
        BaseType::Int => ParamData::Int((5..).take(row.ty.width()).collect()),
        _ => ParamData::Float((3..).map(|i| i as f32 / 8.0).take(row.ty.width()).collect()),
    }
}

fn param(row: &AttributeRow, data: ParamData) -> Param {
    Param { name: row.name.into(), ty: row.ty, data }
}

/// Returns the result of `GetAttribute` when the attribute is not set.
fn default_of(row: &AttributeRow, text: &str) -> Option<ParamData> {
    if row.name == "screen" {
        return Some(ParamData::from(&[-640.0 / 480.0, 640.0 / 480.0, -1.0, 1.0][..]));
    }
    if text == "-" || text.is_empty() {
        return None;
    }
    let words = || text.split(' ').map(|w| w.parse::<f64>().unwrap());
    Some(match row.ty.base {
        BaseType::String => text.trim_matches('"').into(),
        BaseType::Int => ParamData::Int(words().map(|v| v as i32).collect()),
        _ => ParamData::Float(words().map(|v| v as f32).collect()),
    })
}

#[test]
fn every_attribute_is_set_read_and_restored() {
    let mut settable = 0;
    for (_, row, default) in list() {
        if matches!(row.scope, Scope::ReadOnly | Scope::Output) {
            continue;
        }
        settable += 1;
        let mut run = Run::new();
        let default = default_of(row, default);
        assert_eq!(run.get(row), default, "default of {}", row.name);
        let value = other(row);
        run.set(param(row, value.clone()));
        assert_eq!(run.get(row), Some(value.clone()), "{}", row.name);
        // The attribute is set by its name alone, and with another numeric type.
        run.set(Param { ty: ParamType::default(), ..param(row, value.clone()) });
        if let (BaseType::Int, Some(v)) = (row.ty.base, value.to_floats())
            && row.name != "pyg:indent"
        {
            let ty = ParamType { base: BaseType::Float, ..row.ty };
            run.set(Param { name: row.name.into(), ty, data: ParamData::Float(v) });
        }
        if row.name != "pyg:indent" {
            assert_eq!(run.get(row), Some(value), "{}", row.name);
        }
        if let Some(default) = &default
            && row.name != "pyg:indent"
        {
            run.set(param(row, default.clone()));
            assert_eq!(run.get(row).as_ref(), Some(default), "{} put back", row.name);
        }
        assert!(run.said().is_empty(), "{}: {:?}", row.name, run.said());
    }
    assert_eq!(settable, TABLE.len() - 15 - 6, "all but outputs and what can only be asked for");
}

#[test]
fn the_indentation_attribute_is_relative() {
    let row = attribute_row("pyg:indent").unwrap();
    let mut run = Run::new();
    for (change, now) in [(4, 4), (2, 6), (-4, 2), (-9, 0)] {
        run.set(param(row, change.into()));
        assert_eq!(run.get(row), Some(now.into()));
    }
}

#[test]
fn object_attributes_follow_the_state() {
    for (_, row, default) in list().into_iter().filter(|(_, row, _)| row.scope == Scope::Object) {
        let default = default_of(row, default);
        let value = other(row);
        let mut run = Run::new();
        run.call(Call::World);
        run.call(Call::PushAttributes);
        run.set(param(row, value.clone()));
        run.call(Call::SaveAttributes { name: "one".into(), attributes: Some(row.name.into()) });
        run.call(Call::SaveAttributes { name: "all".into(), attributes: None });
        run.call(Call::PopAttributes);
        assert_eq!(run.get(row), default, "{} after PopAttributes", row.name);
        for (saved, items) in [("one", None), ("one", Some(row.name)), ("all", None), ("all", Some(row.name))]
        {
            run.call(Call::PushAttributes);
            run.call(Call::RestoreAttributes { name: saved.into(), attributes: items.map(Into::into) });
            assert_eq!(run.get(row).as_ref(), Some(&value), "{} restored from {saved} {items:?}", row.name);
            run.call(Call::PopAttributes);
        }
        // A saved default is restored over another value.
        run.call(Call::SaveAttributes { name: "default".into(), attributes: Some(row.name.into()) });
        run.set(param(row, value));
        run.call(Call::RestoreAttributes { name: "default".into(), attributes: None });
        assert_eq!(run.get(row), default, "{} restored to its default", row.name);
        assert!(run.said().is_empty(), "{}: {:?}", row.name, run.said());
    }
}

#[test]
fn every_attribute_refuses_the_wrong_type() {
    for (_, row, default) in list() {
        if matches!(row.scope, Scope::ReadOnly) {
            continue;
        }
        let string = row.ty.base == BaseType::String;
        let width = row.ty.width();
        let number = |n: usize| ParamData::Float((1..).map(|i| i as f32).take(n).collect());
        let text = |n: usize| ParamData::String((0..n).map(|_| Arc::from("x")).collect());
        let kind = |base, data: ParamData| {
            let array = Some(data.len() as u32).filter(|n| *n > 1);
            let ty = ParamType { base, array, ..ParamType::default() };
            Param { name: row.name.into(), ty, data }
        };
        let mut wrong = Vec::new();
        if string {
            wrong.push(kind(BaseType::Float, number(1)));
            wrong.push(kind(BaseType::Unknown, number(1)));
            if !row.is_list() {
                wrong.push(kind(BaseType::String, text(2)));
            }
            wrong.push(kind(BaseType::String, text(0)));
            if !row.words().is_empty() {
                wrong.push(kind(BaseType::String, text(1)));
            }
        } else {
            wrong.push(kind(BaseType::String, text(width)));
            wrong.push(kind(BaseType::Unknown, text(width)));
            wrong.push(kind(BaseType::Float, number(width + 1)));
            wrong.push(kind(BaseType::Float, number(0)));
            // The number of values is right, and the declaration is wrong.
            wrong.push(Param {
                ty: ParamType::array(BaseType::Float, 7),
                ..kind(BaseType::Float, number(width))
            });
            wrong.push(kind(BaseType::Unknown, ParamData::Float(vec![f32::NAN; width].into())));
            if row.ty.base == BaseType::Int {
                wrong.push(kind(BaseType::Unknown, ParamData::Float(vec![0.5; width].into())));
                wrong.push(kind(BaseType::Unknown, ParamData::Float(vec![3.0e9; width].into())));
            }
        }
        for param in wrong {
            let mut run = Run::new();
            let shown = format!("{param:?}");
            match row.scope {
                Scope::Output => {
                    let call = Call::Output {
                        name: "a.tif".into(),
                        format: "tiff".into(),
                        data: "rgba".into(),
                        camera: "c".into(),
                        params: Params(vec![param]),
                    };
                    run.call(call);
                }
                _ => run.set(param),
            }
            let said = run.said();
            assert!(
                said.len() == 1 && said[0].contains(&format!("\"{}\"", row.name))
                    || said[0].contains(row.name),
                "{shown}: {said:?}"
            );
            assert!(said[0].starts_with("error"), "{said:?}");
            if row.scope != Scope::Output {
                assert_eq!(run.get(row), default_of(row, default), "{shown} left a trace");
            }
        }
    }
}

#[test]
fn attributes_are_refused_outside_of_their_scope() {
    for (_, row, default) in list() {
        let mut run = Run::new();
        run.call(Call::World);
        run.set(param(row, other(row)));
        let said = run.said();
        let refused = match row.scope {
            Scope::Camera | Scope::Global => "cannot be set after World",
            Scope::ReadOnly => "can be read, not set",
            Scope::Output => "is a parameter of Output",
            Scope::Object | Scope::Writer => {
                assert!(said.is_empty(), "{}: {said:?}", row.name);
                continue;
            }
        };
        assert!(said.len() == 1 && said[0].contains(refused), "{}: {said:?}", row.name);
        if !matches!(row.scope, Scope::ReadOnly) {
            assert_eq!(run.get(row), default_of(row, default), "{} left a trace", row.name);
        }
    }
}

#[test]
fn cameras_refuse_other_attributes_and_outputs_keep_them() {
    for (_, row, _) in list() {
        let params = || Params(vec![param(row, other(row))]);
        let mut run = Run::new();
        run.call(Call::Camera { name: "c".into(), params: params() });
        let said = run.said();
        if row.scope == Scope::Camera {
            assert!(said.is_empty(), "{}: {said:?}", row.name);
            run.call(Call::World);
            assert_eq!(run.get(row), Some(other(row)), "{} of the first camera", row.name);
        } else {
            assert!(said.len() == 1 && said[0].contains("unknown parameter"), "{}: {said:?}", row.name);
        }
        // Outputs pass unknown parameters to the image format.
        let mut run = Run::new();
        let (name, format, data, camera) = ("a.tif".into(), "tiff".into(), "rgba".into(), "c".into());
        run.call(Call::Output { name, format, data, camera, params: params() });
        assert!(run.said().is_empty(), "{}", row.name);
    }
}

#[test]
fn valid_attribute_values_give_no_message() {
    for row in TABLE {
        let mut run = Run::new();
        let call = |run: &mut Run, data: ParamData| match row.scope {
            Scope::Output => {
                let (name, format, data_, camera) =
                    ("a.tif".into(), "tiff".into(), "rgba".into(), "c".into());
                let params = Params(vec![param(row, data)]);
                run.call(Call::Output { name, format, data: data_, camera, params });
            }
            Scope::Camera => {
                run.call(Call::Camera { name: "c".into(), params: Params(vec![param(row, data)]) })
            }
            _ => run.set(param(row, data)),
        };
        if row.scope == Scope::ReadOnly {
            continue;
        }
        if let Some(default) = row.default_param() {
            call(&mut run, default.data);
            assert!(run.said.lock().is_empty(), "{} set to its default", row.name);
        }
        call(&mut run, other(row));
        call(&mut run, other(row));
        assert_eq!(run.said(), Vec::<String>::new());
    }
}

#[test]
fn user_attributes_need_a_type() {
    let mut run = Run::new();
    run.set(Param::declared("user:x", 1.0).unwrap());
    assert!(run.said()[0].contains("needs a type, as in \"float user:x\""));
    let mut set = |declaration: &str, data: ParamData| {
        run.set(Param { data: data.clone(), ..Param::declared(declaration, 0.0).unwrap() });
        assert_eq!(run.state.attribute(declaration).map(|p| p.data), Some(data), "{declaration}");
    };
    set("float user:a", 2.5.into());
    set("int[2] user:b", ParamData::from(&[1, 2][..]));
    set("string user:c", "word".into());
    set("matrix user:m", ParamData::Float((0..16).map(|i| i as f32).collect()));
    set("color[2] user:colors", ParamData::Float((0..6).map(|i| i as f32).collect()));
    // An attribute of another type is a different one. The last declaration is used.
    set("string user:a", "now a word".into());
    assert!(run.state.attribute("float user:a").is_none());
    run.set(Param::declared("float[3] user:d", 1.0).unwrap());
    assert!(run.said()[0].contains("needs 3 values, not 1"));
}
