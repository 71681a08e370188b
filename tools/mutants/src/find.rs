//! Finds what can be changed in a source file: comparisons and arithmetic, conditions, statements, literals, constants,
//! `true` and `false`, `!`, `min` and `max`.
//!
//! Left alone: tests, constant expressions, patterns, types, attributes, what stands inside a macro, and calls that only
//! say how much room there is.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use proc_macro2::LineColumn;
use syn::spanned::Spanned;
use syn::visit::{self, Visit};
use syn::{Attribute, BinOp, Expr, Item, Lit, Stmt, UnOp};

use crate::switch::{Place, Switches, Variant};

/// One change: `old` at a place becomes `new`.
#[derive(Debug)]
pub struct Mutant {
    pub file: PathBuf,
    pub line: usize,
    pub column: usize,
    pub old: String,
    pub new: String,
}

impl std::fmt::Display for Mutant {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        let short = |text: &str| text.split_whitespace().collect::<Vec<_>>().join(" ");
        let (file, old, new) = (self.file.display(), short(&self.old), short(&self.new));
        write!(f, "{file}:{}:{}  {old} -> {}", self.line, self.column, if new.is_empty() { "(removed)" } else { &new })
    }
}

/// Finds the changes of a file, numbered on from those of `mutants`.
pub fn find(file: &Path, source: &str, mutants: &mut Vec<Mutant>) -> syn::Result<Switches> {
    let tree = syn::parse_file(source)?;
    let mut constants = Constants::default();
    constants.visit_file(&tree);
    let mut finder = Finder {
        file,
        source,
        mutants,
        switches: Switches::new(),
        conditions: BTreeSet::new(),
        constants: constants.0,
        of_constants: BTreeMap::new(),
    };
    finder.visit_file(&tree);
    Ok(finder.switches)
}

/// The modules that a file declares for tests only, with no code in the file itself.
pub fn test_modules(source: &str) -> syn::Result<Vec<String>> {
    let items = syn::parse_file(source)?.items;
    let is_outside = |item: &Item| match item {
        Item::Mod(item) if item.content.is_none() && is_for_tests(&item.attrs) => Some(item.ident.to_string()),
        _ => None,
    };
    Ok(items.iter().filter_map(is_outside).collect())
}

fn is_for_tests(attributes: &[Attribute]) -> bool {
    attributes.iter().any(|attribute| {
        let cfg = attribute.meta.require_list().is_ok_and(|list| list.tokens.to_string() == "test");
        attribute.path().is_ident("test") || cfg
    })
}

/// Names of the numeric constants of a file, and whether each is a floating-point number.
#[derive(Default)]
struct Constants(BTreeMap<String, bool>);

impl Constants {
    fn note(&mut self, name: &syn::Ident, of: &syn::Type) {
        let syn::Type::Path(path) = of else { return };
        match path.path.get_ident().map(ToString::to_string).as_deref() {
            Some("f32" | "f64") => self.0.insert(name.to_string(), true),
            Some("u8" | "u16" | "u32" | "u64" | "usize" | "i32" | "i64") => self.0.insert(name.to_string(), false),
            _ => None,
        };
    }
}

impl<'t> Visit<'t> for Constants {
    fn visit_item_const(&mut self, item: &'t syn::ItemConst) {
        self.note(&item.ident, &item.ty);
    }

    fn visit_impl_item_const(&mut self, item: &'t syn::ImplItemConst) {
        self.note(&item.ident, &item.ty);
    }
}

struct Finder<'f> {
    file: &'f Path,
    source: &'f str,
    mutants: &'f mut Vec<Mutant>,
    switches: Switches,
    /// Places of whole conditions: forced to both values, so negating them adds nothing.
    conditions: BTreeSet<(usize, usize)>,
    constants: BTreeMap<String, bool>,
    /// A constant is changed wherever the file uses it.
    of_constants: BTreeMap<String, Vec<usize>>,
}

impl Finder<'_> {
    fn text(&self, node: &impl Spanned) -> &str {
        &self.source[node.span().byte_range()]
    }

    fn mutant(&mut self, at: LineColumn, old: &str, new: &str) -> usize {
        let (file, line, column) = (self.file.to_owned(), at.line, at.column + 1);
        self.mutants.push(Mutant { file, line, column, old: old.to_owned(), new: new.to_owned() });
        self.mutants.len()
    }

    fn switch(&mut self, node: &impl Spanned, is_statement: bool, variant: Variant) {
        let range = node.span().byte_range();
        let place = Place { start: range.start, end: range.end, is_statement };
        self.switches.entry(place).or_default().push(variant);
    }

    /// `old` is what is named; `text` takes the place of the node.
    fn change_part(&mut self, node: &impl Spanned, part: &impl Spanned, new: &str, text: String) {
        let old = self.text(part).to_owned();
        let mutant = self.mutant(part.span().start(), &old, new);
        self.switch(node, false, Variant { mutant, text });
    }

    fn change(&mut self, node: &impl Spanned, text: &str) {
        self.change_part(node, node, text, text.to_owned());
    }

    fn remove(&mut self, statement: &Stmt) {
        let mutant = self.mutant(statement.span().start(), &self.text(statement).to_owned(), "");
        self.switch(statement, true, Variant { mutant, text: String::new() });
    }

    /// Forces a condition, or each part of one that also matches patterns.
    fn force(&mut self, condition: &Expr, values: &[&str]) {
        match condition {
            Expr::Let(_) => {}
            Expr::Binary(binary) if has_pattern(condition) => {
                self.force(&binary.left, values);
                self.force(&binary.right, values);
            }
            _ => {
                let range = condition.span().byte_range();
                self.conditions.insert((range.start, range.end));
                values.iter().for_each(|value| self.change(condition, value));
            }
        }
    }

    /// A function that returns `Result<()>` may end with a call that does the work.
    fn skip_last_call(&mut self, signature: &syn::Signature, body: &syn::Block) {
        if let Some(Stmt::Expr(last @ (Expr::MethodCall(_) | Expr::Call(_)), None)) = body.stmts.last()
            && self.text(&signature.output).replace(' ', "").ends_with("Result<()>")
            && self.text(last) != "Ok(())"
        {
            self.change(last, "Ok(())");
        }
    }
}

fn has_pattern(expression: &Expr) -> bool {
    match expression {
        Expr::Let(_) => true,
        Expr::Binary(binary) if matches!(binary.op, BinOp::And(_)) => {
            has_pattern(&binary.left) || has_pattern(&binary.right)
        }
        _ => false,
    }
}

/// Calls that change how much memory is taken and when, and nothing else.
const OF_ROOM: [&str; 6] =
    ["with_capacity", "reserve", "reserve_exact", "shrink_to_fit", "shrink_to", "release_freed_memory"];

fn is_of_room(expression: &Expr) -> bool {
    let name = match expression {
        Expr::MethodCall(call) => Some(&call.method),
        Expr::Call(call) => match &*call.func {
            Expr::Path(path) => path.path.segments.last().map(|last| &last.ident),
            _ => None,
        },
        _ => None,
    };
    name.is_some_and(|name| OF_ROOM.iter().any(|room| name == room))
}

/// What an operator becomes: at its limit or reversed, and negated.
fn swapped(operator: &BinOp) -> &'static [&'static str] {
    match operator {
        BinOp::Lt(_) => &["<=", ">="],
        BinOp::Le(_) => &["<", ">"],
        BinOp::Gt(_) => &[">=", "<="],
        BinOp::Ge(_) => &[">", "<"],
        BinOp::Eq(_) => &["!="],
        BinOp::Ne(_) => &["=="],
        BinOp::And(_) => &["||"],
        BinOp::Or(_) => &["&&"],
        BinOp::Add(_) => &["-"],
        BinOp::Sub(_) => &["+"],
        BinOp::Mul(_) => &["/"],
        BinOp::Div(_) | BinOp::Rem(_) => &["*"],
        BinOp::BitAnd(_) => &["|"],
        BinOp::BitOr(_) | BinOp::BitXor(_) => &["&"],
        BinOp::Shl(_) => &[">>"],
        BinOp::Shr(_) => &["<<"],
        BinOp::AddAssign(_) => &["-="],
        BinOp::SubAssign(_) => &["+="],
        BinOp::MulAssign(_) => &["/="],
        BinOp::DivAssign(_) => &["*="],
        BinOp::BitOrAssign(_) | BinOp::BitXorAssign(_) => &["&="],
        BinOp::BitAndAssign(_) => &["|="],
        _ => &[],
    }
}

fn attributes(expression: &Expr) -> &[Attribute] {
    match expression {
        Expr::MethodCall(e) => &e.attrs,
        Expr::Call(e) => &e.attrs,
        Expr::Block(e) => &e.attrs,
        Expr::Assign(e) => &e.attrs,
        Expr::If(e) => &e.attrs,
        Expr::Try(e) => attributes(&e.expr),
        _ => &[],
    }
}

impl<'t> Visit<'t> for Finder<'_> {
    fn visit_item_mod(&mut self, item: &'t syn::ItemMod) {
        if !is_for_tests(&item.attrs) {
            visit::visit_item_mod(self, item);
        }
    }

    fn visit_item_impl(&mut self, item: &'t syn::ItemImpl) {
        if !is_for_tests(&item.attrs) {
            visit::visit_item_impl(self, item);
        }
    }

    fn visit_item_fn(&mut self, item: &'t syn::ItemFn) {
        if item.sig.constness.is_none() && !is_for_tests(&item.attrs) {
            self.skip_last_call(&item.sig, &item.block);
            self.visit_block(&item.block);
        }
    }

    fn visit_impl_item_fn(&mut self, item: &'t syn::ImplItemFn) {
        if item.sig.constness.is_none() && !is_for_tests(&item.attrs) {
            self.skip_last_call(&item.sig, &item.block);
            self.visit_block(&item.block);
        }
    }

    fn visit_item_const(&mut self, _: &'t syn::ItemConst) {}
    fn visit_impl_item_const(&mut self, _: &'t syn::ImplItemConst) {}
    fn visit_trait_item_const(&mut self, _: &'t syn::TraitItemConst) {}
    fn visit_item_static(&mut self, _: &'t syn::ItemStatic) {}
    fn visit_variant(&mut self, _: &'t syn::Variant) {}
    fn visit_type(&mut self, _: &'t syn::Type) {}
    fn visit_pat(&mut self, _: &'t syn::Pat) {}
    fn visit_attribute(&mut self, _: &'t Attribute) {}
    fn visit_angle_bracketed_generic_arguments(&mut self, _: &'t syn::AngleBracketedGenericArguments) {}
    fn visit_expr_const(&mut self, _: &'t syn::ExprConst) {}

    fn visit_expr_repeat(&mut self, repeat: &'t syn::ExprRepeat) {
        self.visit_expr(&repeat.expr);
    }

    fn visit_field_value(&mut self, field: &'t syn::FieldValue) {
        if field.colon_token.is_some() {
            self.visit_expr(&field.expr);
        }
    }

    fn visit_stmt(&mut self, statement: &'t Stmt) {
        let of = match statement {
            Stmt::Local(local) => &local.attrs[..],
            Stmt::Expr(expression, _) => attributes(expression),
            _ => &[],
        };
        if of.is_empty() {
            visit::visit_stmt(self, statement);
        }
    }

    fn visit_block(&mut self, block: &'t syn::Block) {
        for statement in &block.stmts {
            let Stmt::Expr(expression, Some(_)) = statement else { continue };
            let called = if let Expr::Try(tried) = expression { &tried.expr } else { expression };
            let goes = match called {
                Expr::Call(_) | Expr::MethodCall(_) | Expr::Assign(_) => !is_of_room(called),
                // Where it is all that a branch does, the condition is forced instead.
                Expr::Return(_) | Expr::Continue(_) | Expr::Break(_) => block.stmts.len() > 1,
                _ => false,
            };
            if goes && attributes(expression).is_empty() {
                self.remove(statement);
            }
        }
        visit::visit_block(self, block);
    }

    fn visit_expr_if(&mut self, node: &'t syn::ExprIf) {
        self.force(&node.cond, &["true", "false"]);
        visit::visit_expr_if(self, node);
    }

    fn visit_expr_while(&mut self, node: &'t syn::ExprWhile) {
        self.force(&node.cond, &["false"]);
        visit::visit_expr_while(self, node);
    }

    fn visit_arm(&mut self, arm: &'t syn::Arm) {
        if let Some((_, guard)) = &arm.guard {
            self.force(guard, &["true", "false"]);
        }
        visit::visit_arm(self, arm);
    }

    fn visit_expr_binary(&mut self, node: &'t syn::ExprBinary) {
        if !has_pattern(&Expr::Binary(node.clone())) {
            let range = node.span().byte_range();
            let count = if self.conditions.contains(&(range.start, range.end)) { 1 } else { 2 };
            for &new in swapped(&node.op).iter().take(count) {
                let (left, right) = (self.text(&node.left), self.text(&node.right));
                let is_assignment = new.len() > 1 && new.ends_with('=') && !matches!(new, "<=" | ">=" | "==" | "!=");
                let left = if is_assignment { left.to_owned() } else { format!("({left})") };
                let text = format!("{left} {new} ({right})");
                self.change_part(node, &node.op, new, text);
            }
        }
        visit::visit_expr_binary(self, node);
    }

    fn visit_expr(&mut self, node: &'t Expr) {
        if !is_of_room(node) {
            visit::visit_expr(self, node);
        }
    }

    fn visit_expr_unary(&mut self, node: &'t syn::ExprUnary) {
        if matches!(node.op, UnOp::Not(_) | UnOp::Neg(_)) {
            let text = self.text(&node.expr).to_owned();
            self.change(node, &text);
        }
        visit::visit_expr_unary(self, node);
    }

    fn visit_expr_lit(&mut self, node: &'t syn::ExprLit) {
        let new = match &node.lit {
            Lit::Bool(value) => (!value.value).to_string(),
            Lit::Int(value) => match value.base10_parse::<u64>().ok().and_then(|value| value.checked_add(1)) {
                Some(next) => format!("{next}{}", value.suffix()),
                None => return,
            },
            Lit::Float(value) => match value.base10_parse::<f64>() {
                Ok(0.0) => format!("1.0{}", value.suffix()),
                Ok(number) => format!("{:?}{}", number * 10.0, value.suffix()),
                Err(_) => return,
            },
            _ => return,
        };
        self.change(node, &new);
    }

    fn visit_expr_path(&mut self, node: &'t syn::ExprPath) {
        let Some(name) = node.path.segments.last().map(|last| last.ident.to_string()) else { return };
        let Some(&is_float) = self.constants.get(&name) else { return };
        let written = self.text(node).to_owned();
        let texts = if is_float {
            vec![format!("10.0 * {written}"), format!("0.1 * {written}")]
        } else {
            vec![format!("{written} + 1")]
        };
        if !self.of_constants.contains_key(&name) {
            let ids = texts.iter().map(|text| self.mutant(node.span().start(), &written, text)).collect();
            self.of_constants.insert(name.clone(), ids);
        }
        for (mutant, text) in self.of_constants[&name].clone().into_iter().zip(texts) {
            self.switch(node, false, Variant { mutant, text });
        }
    }

    fn visit_expr_method_call(&mut self, node: &'t syn::ExprMethodCall) {
        let name = node.method.to_string();
        if node.args.len() == 1 && (name == "min" || name == "max") {
            let new = if name == "min" { "max" } else { "min" };
            let text = format!("({}).{new}({})", self.text(&node.receiver), self.text(&node.args));
            self.change_part(node, &node.method, new, text);
        }
        visit::visit_expr_method_call(self, node);
    }
}
