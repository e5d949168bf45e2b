//! Conditionals (`IfBegin`, `ElseIf`, `Else`, `IfEnd`). They select the requests that are executed.

use crate::condition::{Branch, Value, is_true};
use crate::options::string;
use crate::reader::{Done, Fault, Reader};
use crate::request::Request;
use granita_base::ParamData;

/// The largest depth of nested conditionals.
const MAX_BRANCHES: usize = 1000;

impl Reader<'_> {
    /// Handles conditionals, and requests of branches that are not taken. Returns `None` for a request that must be
    /// executed.
    pub(crate) fn branch(&mut self, request: &Request) -> Option<Done> {
        let outer = self.branches.iter().rev().skip(1).all(|b| b.taken);
        let counts = self.branches.last().is_none_or(|b| b.taken) && outer;
        let mistake = |text: &str| Some(Err(Fault::Mistake(text.to_owned())));
        let condition = |reader: &Self| {
            let text = string(request, 0)?;
            is_true(&text, &|name| reader.variable(name)).map_err(Fault::Mistake)
        };
        match request.name.as_str() {
            "IfBegin" => {
                if self.branches.len() >= MAX_BRANCHES {
                    return mistake("conditionals are nested too deep");
                }
                // A condition that cannot be read is false, so that its `IfEnd` has an `IfBegin`.
                let (taken, done) = match counts.then(|| condition(self)) {
                    None => (false, Ok(())),
                    Some(Ok(taken)) => (taken, Ok(())),
                    Some(Err(fault)) => (false, Err(fault)),
                };
                self.branches.push(Branch { line: request.line, taken, done: taken || !counts, last: false });
                Some(done)
            }
            "ElseIf" | "Else" => {
                let Some(mut branch) = self.branches.pop() else { return mistake("without IfBegin") };
                if branch.last {
                    branch.taken = false;
                    self.branches.push(branch);
                    return mistake("behind Else");
                }
                branch.last = request.name == "Else";
                let wanted = outer && !branch.done;
                let (taken, done) = match (wanted, branch.last) {
                    (false, _) => (false, Ok(())),
                    (true, true) => (true, Ok(())),
                    (true, false) => match condition(self) {
                        Ok(taken) => (taken, Ok(())),
                        Err(fault) => (false, Err(fault)),
                    },
                };
                branch.taken = taken;
                branch.done |= taken;
                self.branches.push(branch);
                Some(done)
            }
            "IfEnd" => match self.branches.pop() {
                Some(_) => Some(Ok(())),
                None => mistake("without IfBegin"),
            },
            _ => (!counts).then_some(Ok(())),
        }
    }

    /// Returns the value of a name in a condition.
    fn variable(&self, name: &str) -> Option<Value> {
        let name = ["Attribute:", "Option:"].iter().find_map(|p| name.strip_prefix(p)).unwrap_or(name);
        let attribute = || {
            let param = self.attribute_value(name).filter(|_| name.starts_with("user:"))?;
            match &param.data {
                ParamData::String(v) => v.first().map(|s| Value::Text(s.to_string())),
                ParamData::Int(v) => v.first().map(|x| Value::Number(f64::from(*x))),
                ParamData::Float(v) => v.first().map(|x| Value::Number(f64::from(*x))),
            }
        };
        attribute().or_else(|| self.variables.get(name).cloned())
    }
}
