//! The page of attributes, which is made from their table.

use crate::kept;
use granita_scene::attribute::{DefaultValue, Effect, Scope, TABLE};
use std::fmt::Write;

fn numbers<T: Copy + Into<f64>>(list: &[T]) -> String {
    let shown = |v: f64| if v.abs() >= 1e7 { format!("{:e}", v as f32) } else { format!("{}", v as f32) };
    list.iter().map(|v| shown((*v).into())).collect::<Vec<_>>().join(" ")
}

#[test]
fn the_manual_lists_every_attribute() {
    let mut text = String::from(
        "# Attributes\n\nOne row for each attribute, from the table that the programs themselves use. `Attribute (\"TYPE \
         NAME\", VALUE)` sets one, `GetAttribute (\"NAME\")` asks for it.\n\nNumbers \
         of any type become those of the attribute as long as nothing is lost; a string where a number belongs, or the \
         wrong number of values, is an error and changes nothing. An attribute marked *hint* \
         tunes how the work is done, and this renderer needs no tuning there. One marked *re-render* may change between \
         the frames of [re-rendering mode](rerender.md): those of objects by `Modify`, the others before `World`.\n",
    );
    for (scope, title) in [
        (Scope::Camera, "Of cameras"),
        (Scope::Output, "Of outputs"),
        (Scope::Global, "Of the scene, before `World`"),
        (Scope::Object, "Of objects and lights"),
        (Scope::Writer, "Of writers of scene files"),
        (Scope::ReadOnly, "To be asked for only"),
    ] {
        let _ = write!(text, "\n## {title}\n\n| attribute | default | meaning |\n|---|---|---|\n");
        for row in TABLE.iter().filter(|row| row.scope == scope) {
            let shown = match row.default {
                DefaultValue::Unset => String::new(),
                DefaultValue::Floats(v) => format!("`{}`", numbers(v)),
                DefaultValue::Ints(v) => format!("`{}`", numbers(v)),
                DefaultValue::Text(v) | DefaultValue::OneOf(&[v, ..]) => format!("`\"{v}\"`"),
                DefaultValue::OneOf(&[]) => String::new(),
            };
            let mut help = row.help.replace('|', "\\|");
            help += match row.effect {
                Effect::Full => "",
                Effect::Hint => "; *hint*",
            };
            if row.rerender {
                help += "; *re-render*";
            }
            let _ = writeln!(text, "| `{}` | {shown} | {help} |", row.declaration());
        }
    }
    kept("docs/attributes.md", &text);
}
