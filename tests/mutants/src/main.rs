//! Puts all mutants of some folders of Rust into their sources at once, each behind a number that a variable chooses at
//! run time: `mutants TREE FOLDER...` rewrites `TREE/FOLDER/**/*.rs` in place, adds `mutant` to `TREE/rust/lib.rs`, and prints
//! a line for each: number, file, line, what it does.
//!
//! A tool that builds every mutant by itself takes 15 seconds of CPU for each of two thousand; here one build has them all.
//! The operators are those of cargo-mutants: arithmetic, comparisons, Boolean and bitwise operators, negations, and
//! functions that return at once. What the compiler evaluates itself, and what stands in macros, is left as it is.

use std::fs;
use std::path::{Path, PathBuf};

use quote::ToTokens;
use syn::spanned::Spanned;
use syn::visit_mut::{VisitMut, visit_expr_mut, visit_impl_item_fn_mut, visit_item_fn_mut};
use syn::{BinOp, Block, Expr, ExprBinary, ImplItemFn, ItemFn, ReturnType, Signature, UnOp, parse_quote};

/// Which of them lives is asked for at the first question.
const SWITCH: &str = r#"
/// Whether a mutant has been switched on (`tests/mutants`).
#[inline(always)]
pub fn mutant(number: u32) -> bool {
    use std::sync::atomic::{AtomicU32, Ordering::Relaxed};
    static ACTIVE: AtomicU32 = AtomicU32::new(u32::MAX);
    #[cold]
    fn ask() -> u32 {
        let asked = std::env::var("MUTANT").ok().and_then(|text| text.parse().ok()).unwrap_or(0);
        ACTIVE.store(asked, Relaxed);
        asked
    }
    let active = ACTIVE.load(Relaxed);
    number == if active == u32::MAX { ask() } else { active }
}
"#;

struct Mutants {
    file: String,
    /// Numbers that do not compile.
    left_out: Vec<u32>,
    last: u32,
}

impl Mutants {
    /// A number for a mutant, which is told; none where it is left out.
    fn number(&mut self, line: usize, what: String) -> Option<u32> {
        self.last += 1;
        if self.left_out.contains(&self.last) {
            return None;
        }
        println!("{}\t{}\t{line}\t{what}", self.last, self.file);
        Some(self.last)
    }

    /// A binary expression whose parts have been looked at already.
    fn binary(&mut self, binary: &ExprBinary) -> Option<Expr> {
        let ExprBinary { left, op, right, .. } = binary;
        let text = |op: &BinOp| op.to_token_stream().to_string();
        let line = op.span().start().line;
        let both: BinOp = match op {
            BinOp::And(_) | BinOp::Or(_) => {
                if has_let(left) || has_let(right) {
                    return None;
                }
                let number = self.number(line, format!("{} is the other", text(op)))?;
                return Some(match op {
                    BinOp::And(_) => {
                        parse_quote!({ let l = #left; if l == crate::mutant(#number) { l } else { #right } })
                    }
                    _ => parse_quote!({ let l = #left; if l != crate::mutant(#number) { l } else { #right } }),
                });
            }
            BinOp::Add(_) => parse_quote!(-),
            BinOp::Sub(_) => parse_quote!(+),
            BinOp::Mul(_) => parse_quote!(/),
            BinOp::Div(_) => parse_quote!(*),
            BinOp::Rem(_) => parse_quote!(/),
            BinOp::BitAnd(_) => parse_quote!(|),
            BinOp::BitOr(_) => parse_quote!(&),
            BinOp::BitXor(_) => parse_quote!(|),
            BinOp::Shl(_) => parse_quote!(>>),
            BinOp::Shr(_) => parse_quote!(<<),
            BinOp::Lt(_) => parse_quote!(<=),
            BinOp::Le(_) => parse_quote!(<),
            BinOp::Gt(_) => parse_quote!(>=),
            BinOp::Ge(_) => parse_quote!(>),
            BinOp::Eq(_) => parse_quote!(!=),
            BinOp::Ne(_) => parse_quote!(==),
            BinOp::AddAssign(_) => parse_quote!(-=),
            BinOp::SubAssign(_) => parse_quote!(+=),
            BinOp::MulAssign(_) => parse_quote!(/=),
            BinOp::DivAssign(_) => parse_quote!(*=),
            BinOp::BitAndAssign(_) => parse_quote!(|=),
            BinOp::BitOrAssign(_) => parse_quote!(&=),
            _ => return None,
        };
        let number = self.number(line, format!("{} is {}", text(op), text(&both)))?;
        Some(match op {
            BinOp::Lt(_) | BinOp::Le(_) | BinOp::Gt(_) | BinOp::Ge(_) | BinOp::Eq(_) | BinOp::Ne(_) => parse_quote!(
                match (&(#left), &(#right)) { (l, r) => if crate::mutant(#number) { l #both r } else { l #op r } }
            ),
            _ if text(op).ends_with('=') => {
                parse_quote!(if crate::mutant(#number) { #left #both #right } else { #left #op #right })
            }
            _ => parse_quote!(
                match (#left, #right) { (l, r) => if crate::mutant(#number) { l #both r } else { l #op r } }
            ),
        })
    }

    /// Returns at once, with each of a few values that the type of the function tells.
    fn returning(&mut self, signature: &Signature, block: &mut Block) {
        let line = signature.span().start().line;
        let kind = match &signature.output {
            ReturnType::Default => String::new(),
            ReturnType::Type(_, kind) => kind.to_token_stream().to_string().replace(' ', ""),
        };
        let values: &[&str] = match kind.as_str() {
            "" => &["()"],
            "bool" => &["true", "false"],
            "Result<()>" => &["Ok(())"],
            "f32" | "f64" => &["0.0", "1.0"],
            "usize" | "u8" | "u16" | "u32" | "u64" | "i16" | "i32" | "i64" => &["0", "1"],
            _ => &[],
        };
        for value in values {
            let what = format!("{} returns {value}", signature.ident);
            let expression: Expr = syn::parse_str(value).expect("an expression of the table above");
            if let Some(number) = self.number(line, what) {
                block.stmts.insert(0, parse_quote!(if crate::mutant(#number) { return #expression; }));
            }
        }
    }
}

/// Conditions that bind names cannot be moved.
fn has_let(expression: &Expr) -> bool {
    match expression {
        Expr::Let(_) => true,
        Expr::Binary(binary) => has_let(&binary.left) || has_let(&binary.right),
        Expr::Paren(inner) => has_let(&inner.expr),
        _ => false,
    }
}

impl VisitMut for Mutants {
    fn visit_expr_mut(&mut self, expression: &mut Expr) {
        if matches!(expression, Expr::Const(_)) {
            return;
        }
        // A repeated array's length is a constant.
        if let Expr::Repeat(repeat) = expression {
            self.visit_expr_mut(&mut repeat.expr);
            return;
        }
        visit_expr_mut(self, expression);
        let changed = match expression {
            Expr::Binary(binary) => self.binary(binary),
            Expr::Unary(unary) if matches!(unary.op, UnOp::Not(_) | UnOp::Neg(_)) && !literal(&unary.expr) => {
                let (op, inner, line) = (&unary.op, &unary.expr, unary.span().start().line);
                let number = self.number(line, format!("{} is left out", op.to_token_stream()));
                number.map(|number| parse_quote!(match #inner { x => if crate::mutant(#number) { x } else { #op x } }))
            }
            _ => None,
        };
        if let Some(changed) = changed {
            *expression = parse_quote!((#changed));
        }
    }

    fn visit_item_fn_mut(&mut self, function: &mut ItemFn) {
        if function.sig.constness.is_none() {
            visit_item_fn_mut(self, function);
            self.returning(&function.sig, &mut function.block);
        }
    }

    fn visit_impl_item_fn_mut(&mut self, function: &mut ImplItemFn) {
        if function.sig.constness.is_none() {
            visit_impl_item_fn_mut(self, function);
            self.returning(&function.sig, &mut function.block);
        }
    }

    fn visit_item_const_mut(&mut self, _: &mut syn::ItemConst) {}
    fn visit_item_static_mut(&mut self, _: &mut syn::ItemStatic) {}
    fn visit_impl_item_const_mut(&mut self, _: &mut syn::ImplItemConst) {}
    fn visit_type_mut(&mut self, _: &mut syn::Type) {}
    fn visit_pat_mut(&mut self, _: &mut syn::Pat) {}
    fn visit_generic_argument_mut(&mut self, _: &mut syn::GenericArgument) {}
    fn visit_attribute_mut(&mut self, _: &mut syn::Attribute) {}
}

fn literal(expression: &Expr) -> bool {
    matches!(expression, Expr::Lit(_))
}

fn sources(folder: &Path, found: &mut Vec<PathBuf>) {
    let mut all: Vec<_> =
        fs::read_dir(folder).expect("a folder").map(|entry| entry.expect("an entry").path()).collect();
    all.sort();
    for path in all {
        if path.is_dir() {
            sources(&path, found);
        } else if path.extension().is_some_and(|end| end == "rs") {
            found.push(path);
        }
    }
}

fn main() {
    let mut arguments = std::env::args().skip(1);
    let tree = PathBuf::from(arguments.next().expect("a copy of the tree"));
    // As numbers in LEFT_OUT, with commas between them.
    let left_out = std::env::var("LEFT_OUT").unwrap_or_default();
    let left_out = left_out.split(',').filter_map(|number| number.parse().ok()).collect();
    let mut mutants = Mutants { file: String::new(), left_out, last: 0 };
    for folder in arguments {
        let mut files = Vec::new();
        sources(&tree.join(folder), &mut files);
        for path in files {
            mutants.file = path.strip_prefix(&tree).expect("below the tree").display().to_string();
            let mut file = syn::parse_file(&fs::read_to_string(&path).expect("a file")).expect("Rust");
            mutants.visit_file_mut(&mut file);
            fs::write(&path, prettyplease::unparse(&file)).expect("a file");
        }
    }
    let lib = tree.join("rust/lib.rs");
    let before = fs::read_to_string(&lib).expect("a file");
    fs::write(&lib, format!("#![allow(warnings, clippy::all)]\n{before}\n{SWITCH}")).expect("a file");
}
