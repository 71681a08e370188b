//! Numbers in `docs/reference` are those of the code. A comment behind a number names the file below `src` and the
//! constant: `512 KiB<!-- read/source.rs CHUNK_BYTES -->`.

use std::fs;
use std::path::Path;

use syn::visit::Visit;
use syn::{BinOp, Expr, Lit};

/// Units that stand between a number and its comment.
const UNITS: [(&str, f64); 4] = [(" KiB", 1024.0), (" MiB", 1_048_576.0), (" GiB", 1_073_741_824.0), ("", 1.0)];

/// Looks for a constant, in impl blocks and functions, too.
struct Search<'a> {
    name: &'a str,
    found: Option<Expr>,
}

impl Visit<'_> for Search<'_> {
    fn visit_item_const(&mut self, item: &syn::ItemConst) {
        if item.ident == self.name {
            self.found = Some((*item.expr).clone());
        }
    }

    fn visit_impl_item_const(&mut self, item: &syn::ImplItemConst) {
        if item.ident == self.name {
            self.found = Some(item.expr.clone());
        }
    }
}

/// The value of a constant of a file below `src`.
fn value_of(file: &str, name: &str) -> Result<f64, String> {
    let text = fs::read_to_string(Path::new("src").join(file)).map_err(|error| format!("{file}: {error}"))?;
    let parsed = syn::parse_file(&text).map_err(|error| format!("{file}: {error}"))?;
    let mut search = Search { name, found: None };
    search.visit_file(&parsed);
    let found = search.found.ok_or_else(|| format!("{file} has no constant {name}"))?;
    value(&found, file).ok_or_else(|| format!("{name} of {file} is no plain number"))
}

fn value(expression: &Expr, file: &str) -> Option<f64> {
    match expression {
        Expr::Lit(literal) => match &literal.lit {
            Lit::Int(number) => number.base10_parse::<u64>().ok().map(|number| number as f64),
            Lit::Float(number) => number.base10_parse().ok(),
            _ => None,
        },
        Expr::Paren(inner) => value(&inner.expr, file),
        Expr::Cast(cast) => value(&cast.expr, file),
        Expr::Path(path) => value_of(file, &path.path.get_ident()?.to_string()).ok(),
        Expr::Binary(operation) => {
            let (left, right) = (value(&operation.left, file)?, value(&operation.right, file)?);
            Some(match operation.op {
                BinOp::Add(_) => left + right,
                BinOp::Sub(_) => left - right,
                BinOp::Mul(_) => left * right,
                BinOp::Div(_) => left / right,
                BinOp::Shl(_) => left * right.exp2(),
                _ => return None,
            })
        }
        _ => None,
    }
}

/// The number before a comment, its unit included.
fn number_before(text: &str) -> Option<f64> {
    let (digits, factor) = UNITS.iter().find_map(|&(unit, factor)| Some((text.strip_suffix(unit)?, factor)))?;
    let start = digits.rfind(|c: char| !c.is_ascii_digit() && c != ',' && c != '.').map_or(0, |at| at + 1);
    digits[start..].replace(',', "").parse::<f64>().ok().map(|number| number * factor)
}

/// What is wrong with the numbers of a page, and how many have a comment.
fn faults_of(page: &str) -> (Vec<String>, usize) {
    let (mut faults, mut count, mut rest) = (Vec::new(), 0, page);
    while let Some((before, after)) = rest.split_once("<!-- ") {
        let Some((comment, after)) = after.split_once(" -->") else { break };
        let shown = before.lines().next_back().unwrap_or_default();
        match (comment.split_once(' ').map(|(file, name)| value_of(file, name)), number_before(shown)) {
            (Some(Ok(value)), Some(number)) if value == number => count += 1,
            (Some(Ok(value)), _) => faults.push(format!("{shown}: {comment} is {value}")),
            (Some(Err(fault)), _) => faults.push(fault),
            (None, _) => faults.push(format!("{comment}: not a file and a constant")),
        }
        rest = after;
    }
    (faults, count)
}

#[test]
fn numbers_of_the_reference_are_those_of_the_code() {
    let mut counted = 0;
    for name in ["input.md", "comparison.md", "report.md", "work-folder.md"] {
        let text = fs::read_to_string(Path::new("docs/reference").join(name)).unwrap();
        let (faults, count) = faults_of(&text);
        assert!(faults.is_empty(), "{name}: {faults:#?}");
        counted += count;
        // A size in one of these units is a limit, so it comes from the code.
        for line in text.lines() {
            for (unit, _) in &UNITS[..3] {
                for (at, _) in
                    line.match_indices(unit).filter(|(at, _)| line[..*at].ends_with(|c: char| c.is_ascii_digit()))
                {
                    assert!(line[at + unit.len()..].starts_with("<!-- "), "{name}: which constant is it? {line}");
                }
            }
        }
    }
    assert!(counted >= 20, "{counted} numbers are compared");
}

#[test]
fn a_number_that_differs_is_a_fault() {
    let page = |number: &str| format!("chunks of {number}<!-- read/source.rs CHUNK_BYTES -->, and\n");
    assert_eq!(faults_of(&page("512 KiB")), (Vec::new(), 1));
    assert_eq!(faults_of(&page("524,288")), (Vec::new(), 1));
    for wrong in ["513 KiB", "512 MiB", "512", "many"] {
        assert_eq!(faults_of(&page(wrong)).0.len(), 1, "{wrong}");
    }
    assert!(faults_of("1<!-- read/source.rs NO_SUCH -->").0[0].contains("no constant"));
}
