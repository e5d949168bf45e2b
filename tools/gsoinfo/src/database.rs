//! The content of a spatial database.

use granita_cli::print;
use granita_sdb::Packed;
use serde_json::{Value, json};
use std::fmt::Write;

/// The number of records that are printed at once.
const CHUNK: usize = 4096;

/// The sum and the range of the values that a query would return.
struct Summary {
    components: usize,
    sum: [f64; 3],
    least: [f32; 3],
    most: [f32; 3],
}

impl Summary {
    fn new(records: &Packed) -> Self {
        let components = records.schema().value.components();
        let mut out =
            Self { components, sum: [0.0; 3], least: [f32::INFINITY; 3], most: [f32::NEG_INFINITY; 3] };
        for i in 0..records.len() {
            for (c, v) in records.value(i).into_iter().take(components).enumerate() {
                out.sum[c] += f64::from(v);
                out.least[c] = out.least[c].min(v);
                out.most[c] = out.most[c].max(v);
            }
        }
        out
    }
}

fn row<T: ToString>(numbers: &[T]) -> String {
    numbers.iter().map(T::to_string).collect::<Vec<_>>().join(" ")
}

/// Prints the database as text. With `verbose` the records follow.
pub(crate) fn show(name: &str, records: &Packed, verbose: bool) {
    let schema = records.schema();
    let mut text = format!("database {name}\n  {}\n  records {}\n", schema.words(), records.len());
    if let Some((lo, hi)) = records.bound() {
        let d = schema.key.dimensions();
        let s = Summary::new(records);
        // Writing to a string does not fail.
        let _ = writeln!(text, "  box [{}] [{}]", row(&lo[..d]), row(&hi[..d]));
        let _ = writeln!(text, "  sum [{}]", row(&s.sum[..s.components]));
        let _ = writeln!(text, "  least [{}]", row(&s.least[..s.components]));
        let _ = writeln!(text, "  most [{}]", row(&s.most[..s.components]));
    }
    print(&text);
    if verbose {
        let mut first = 0;
        while first < records.len() {
            let to = (first + CHUNK).min(records.len());
            print(&(first..to).map(|i| row(records.record(i)) + "\n").collect::<String>());
            first = to;
        }
    }
}

/// Returns the description of the database as JSON, without the records.
pub(crate) fn json(name: &str, records: &Packed) -> Value {
    let schema = records.schema();
    let s = Summary::new(records);
    let d = schema.key.dimensions();
    let bound = records.bound().map(|(lo, hi)| json!([lo[..d], hi[..d]]));
    let some = |x: &[f32]| (!records.is_empty()).then(|| json!(x[..s.components]));
    json!({
        "database": name,
        "key": schema.key.word(),
        "value": schema.value.word(),
        "records": records.len(),
        "box": bound,
        "sum": s.sum[..s.components],
        "least": some(&s.least),
        "most": some(&s.most),
    })
}
