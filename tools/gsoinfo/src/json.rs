//! The description of a shader, as JSON.

use granita_gsl::ir::{ConstValue, Metadatum, ValueType};
use granita_gsl::{Arg, GsoArgs};
use serde_json::{Map, Value, json};

/// Returns the object of one shader: `type`, `name`, `metadata` and `parameters` in the order of their declaration.
///
/// A parameter has `name`, `type`, `output`, `default` (absent when it is computed), `space` (of triples and matrices:
/// a name, or a list of names where the elements of an array are in different spaces) and `metadata`. An array also has
/// `length` and `variable` (true when an instance may have another length). A triple or matrix is an array of numbers.
/// A value that is not a finite number is a string.
pub(crate) fn describe(args: &GsoArgs) -> Value {
    json!({
        "type": args.shadertype(),
        "name": args.shadername(),
        "metadata": metadata(args.metadata()),
        "parameters": args.args().iter().map(parameter).collect::<Vec<_>>(),
    })
}

fn parameter(arg: &Arg) -> Value {
    let mut object = Map::new();
    object.insert("name".into(), json!(&*arg.name));
    object.insert("type".into(), json!(arg.ty.value.word()));
    if let Some(length) = arg.ty.array {
        object.insert("length".into(), json!(length));
        object.insert("variable".into(), json!(arg.ty.open));
    }
    object.insert("output".into(), json!(arg.is_output));
    if let Some(default) = &arg.default {
        let mut values = elements(arg.ty.value, &default.value);
        let value =
            if arg.ty.array.is_none() && values.len() == 1 { values.remove(0) } else { values.into() };
        object.insert("default".into(), value);
        match default.spaces.as_slice() {
            [] => None,
            [first, rest @ ..] if rest.iter().all(|s| s == first) => {
                object.insert("space".into(), json!(&**first))
            }
            all => {
                let names: Vec<&str> = all.iter().map(|s| &**s).collect();
                object.insert("space".into(), json!(names))
            }
        };
    }
    object.insert("metadata".into(), metadata(&arg.metadata));
    Value::Object(object)
}

fn metadata(list: &[Metadatum]) -> Value {
    let one = |m: &Metadatum| {
        let mut values = elements(m.ty, &m.value);
        let value = if values.len() == 1 { values.remove(0) } else { values.into() };
        json!({ "name": &*m.name, "type": m.ty.word(), "value": value })
    };
    list.iter().map(one).collect::<Vec<_>>().into()
}

/// Returns one value per element.
fn elements(ty: ValueType, value: &ConstValue) -> Vec<Value> {
    match value {
        ConstValue::Strings(list) => list.iter().map(|s| json!(&**s)).collect(),
        ConstValue::Floats(list) => list
            .chunks(ty.components().max(1))
            .map(|element| match element {
                [x] => number(*x),
                several => several.iter().map(|x| number(*x)).collect::<Vec<_>>().into(),
            })
            .collect(),
    }
}

/// Converts a number, with as many digits as the float needs.
fn number(x: f32) -> Value {
    let text = x.to_string();
    match text.parse::<f64>() {
        Ok(v) if v.is_finite() => json!(v),
        _ => json!(text),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use granita_gsl::{CompileOptions, compile};

    #[test]
    fn json_lists_all_parameters_and_metadata() {
        let source = "surface t [[ string description = \"d\" ]] (float a = 0.1 [[ color c = color (1, 2, 3) ]], \
            point p = point (\"shader\", 1, 2, 3), string n[] = { \"x\", \"y\" }, output float o = u) { o = a; }";
        let module = compile(source, "t.gsl", &CompileOptions::default()).unwrap().module;
        assert_eq!(
            describe(&GsoArgs::from_module(&module)),
            json!({
                "type": "surface", "name": "t",
                "metadata": [{ "name": "description", "type": "string", "value": "d" }],
                "parameters": [
                    { "name": "a", "type": "float", "output": false, "default": 0.1,
                      "metadata": [{ "name": "c", "type": "color", "value": [1.0, 2.0, 3.0] }] },
                    { "name": "p", "type": "point", "output": false, "default": [1.0, 2.0, 3.0],
                      "space": "shader", "metadata": [] },
                    { "name": "n", "type": "string", "length": 2, "variable": true, "output": false,
                      "default": ["x", "y"], "metadata": [] },
                    { "name": "o", "type": "float", "output": true, "metadata": [] },
                ],
            })
        );
        assert_eq!(number(f32::INFINITY), json!("inf"));
    }
}
