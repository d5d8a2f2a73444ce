//! The table of commands. A new command is a file with its arguments and `execute`, and one line here.

use std::ffi::OsString;
use std::fmt::Write;
use std::ops::RangeInclusive;
use std::sync::LazyLock;

use clap::builder::StyledStr;
use clap::{Args, ColorChoice, CommandFactory, FromArgMatches, Parser, Subcommand, ValueEnum};

use super::columns;
use super::error::CliError;
use super::examples::{HEADING, examples};
use super::output::{Exit, Output};
use super::tone::width_of_stdout;
use super::{
    accuracy, attach, audit, completions, copy, dag, diff, doctor, explain, export, fsck, gc, init, log, man, pin,
    plan, predict, pull, push, remote, report, run, schema, screen, serve, show, sketch, solve, status, sweep, unpin,
    worker,
};

/// The name of the program.
pub const PROGRAM: &str = "deaflow";

/// The environment variable that says how many threads to use.
pub const JOBS: &str = "DEAFLOW_JOBS";

/// How many threads may be asked for.
pub const MOST_JOBS: RangeInclusive<u16> = 1..=1024;

/// The widest line of help.
const WIDTH: usize = 100;

/// The fewest columns in which the list of commands says what each does.
const LEAST: usize = 20;

/// What `--version` says.
static VERSION: LazyLock<String> = LazyLock::new(deaflow_base::version);

/// Designs dielectric-elastomer actuators, reproducibly: sample, solve, balance, train, design, verify.
#[derive(Debug, Parser)]
#[command(
    name = PROGRAM,
    version = VERSION.as_str(),
    about,
    propagate_version = true,
    after_help = examples!("deaflow init demo", "deaflow run demo/pipeline.yaml", "deaflow help run")
)]
pub struct Cli {
    #[command(subcommand)]
    command: Command,
    #[command(flatten)]
    pub global: GlobalArguments,
}

#[derive(Debug, Args)]
#[command(next_help_heading = "Global options")]
pub struct GlobalArguments {
    /// Print one JSON document on stdout; progress goes to stderr either way
    #[arg(long, global = true)]
    pub json: bool,
    /// Threads to use [default: $DEAFLOW_JOBS, or else one per core]; results do not depend on it
    #[arg(short, long, global = true, value_name = "N", value_parser = jobs)]
    pub jobs: Option<u16>,
    /// Whether to use colours: auto, always or never; auto heeds NO_COLOR and CLICOLOR_FORCE
    #[arg(
        long,
        global = true,
        value_name = "WHEN",
        default_value = "auto",
        hide_default_value = true,
        hide_possible_values = true
    )]
    pub color: ColorChoice,
}

/// Reads a number of threads.
pub fn jobs(text: &str) -> Result<u16, String> {
    let number = text.trim().parse().ok().filter(|number| MOST_JOBS.contains(number));
    number.ok_or_else(|| format!("allowed: {} to {}", MOST_JOBS.start(), MOST_JOBS.end()))
}

/// Declares the commands in the order of `deaflow --help`, under headings; the first sentence of each is the comment on its arguments.
macro_rules! commands {
    ($($heading:literal: $($command:ident => $file:ident::$arguments:ident,)*)*) => {
        #[derive(Debug, Subcommand)]
        enum Command {
            $($($command($file::$arguments),)*)*
        }

        /// Names of commands by their headings.
        const GROUPS: &[(&str, &[&str])] = &[$(($heading, &[$(stringify!($command)),*])),*];

        impl Cli {
            /// Runs the command that is named.
            pub fn execute(&self, output: &Output) -> Result<Exit, CliError> {
                match &self.command {
                    $($(Command::$command(arguments) => $file::execute(arguments, output),)*)*
                }
            }
        }
    };
}

commands! {
    "Start and build":
    Init => init::InitArguments,
    Run => run::RunArguments,
    Plan => plan::PlanArguments,
    Sweep => sweep::SweepArguments,
    Status => status::StatusArguments,
    Attach => attach::AttachArguments,
    Worker => worker::WorkerArguments,
    "Look and export":
    Log => log::LogArguments,
    Diff => diff::DiffArguments,
    Explain => explain::ExplainArguments,
    Dag => dag::DagArguments,
    Show => show::ShowArguments,
    Report => report::ReportArguments,
    Export => export::ExportArguments,
    Serve => serve::ServeArguments,
    "Store and exchange":
    Fsck => fsck::FsckArguments,
    Gc => gc::GcArguments,
    Doctor => doctor::DoctorArguments,
    Pin => pin::PinArguments,
    Unpin => unpin::UnpinArguments,
    Copy => copy::CopyArguments,
    Remote => remote::RemoteCommand,
    Push => push::PushArguments,
    Pull => pull::PullArguments,
    "Solve and measure":
    Solve => solve::SolveArguments,
    Sketch => sketch::SketchArguments,
    Predict => predict::PredictArguments,
    Screen => screen::ScreenArguments,
    Accuracy => accuracy::AccuracyArguments,
    Audit => audit::AuditArguments,
    "Help and set-up":
    Schema => schema::SchemaArguments,
    Completions => completions::CompletionsArguments,
    Man => man::ManArguments,
}

/// What clap adds to the last group.
const HELP: (&str, &str) = ("help", "Print the help of a command");

impl Cli {
    /// Reads a command line.
    ///
    /// # Errors
    /// When it is none, or help was asked for.
    pub fn read(arguments: &[OsString], colour: ColorChoice) -> Result<Self, clap::Error> {
        let mut command = command_line().color(colour);
        let matches = command.try_get_matches_from_mut(arguments)?;
        Self::from_arg_matches(&matches).map_err(|error| error.format(&mut command))
    }
}

/// Whether colours are asked for, found without clap: what cannot be read is refused later.
pub fn colour_in(arguments: &[OsString]) -> ColorChoice {
    let words = arguments.iter().filter_map(|word| word.to_str());
    let next = words.clone().skip(1).map(Some).chain([None]);
    let given = words.zip(next).filter_map(|(word, next)| match word {
        "--color" => next,
        word => word.strip_prefix("--color="),
    });
    let read = given.filter_map(|word| ColorChoice::from_str(word, false).ok());
    read.last().unwrap_or(ColorChoice::Auto)
}

/// The command line as it is declared, with the commands under their headings.
pub fn command_line() -> clap::Command {
    let command = Cli::command().max_term_width(WIDTH);
    let overview = overview(&command, width_of_stdout().unwrap_or(WIDTH).min(WIDTH));
    with_styled_examples(command).help_template(overview)
}

/// The help of the program itself, in lines of no more than so many columns. Clap knows no headings among commands.
fn overview(command: &clap::Command, most: usize) -> StyledStr {
    let header = command.get_styles().get_header();
    let literal = command.get_styles().get_literal();
    let names = || command.get_subcommands().map(|command| command.get_name().len());
    let width = names().max().unwrap_or(0);
    let mut text = "{about-with-newline}\n{usage-heading} {usage}\n".to_owned();
    let line = |text: &mut String, name: &str, about: &str| {
        let mut lines = textwrap::wrap(about, columns::words(most.saturating_sub(width + 4).max(LEAST))).into_iter();
        // Writing to a text cannot fail.
        let first = lines.next().unwrap_or_default();
        let _ = writeln!(text, "  {literal}{name:width$}{literal:#}  {first}");
        for rest in lines {
            let _ = writeln!(text, "{:1$}{rest}", "", width + 4);
        }
    };
    for (at, (heading, commands)) in GROUPS.iter().enumerate() {
        let _ = writeln!(text, "\n{header}{heading}:{header:#}");
        for name in *commands {
            let name = name.to_lowercase();
            let about = command.find_subcommand(&name).and_then(clap::Command::get_about);
            line(&mut text, &name, &about.map(ToString::to_string).unwrap_or_default());
        }
        if at + 1 == GROUPS.len() {
            line(&mut text, HELP.0, HELP.1);
        }
    }
    let _ = write!(text, "\n{header}Options:{header:#}\n{{options}}{{after-help}}");
    text.into()
}

/// The headings of examples look like those that clap writes.
fn with_styled_examples(command: clap::Command) -> clap::Command {
    let header = *command.get_styles().get_header();
    let text = command.get_after_help().map(ToString::to_string).unwrap_or_default();
    let command = match text.strip_prefix(HEADING) {
        Some(lines) => command.after_help(StyledStr::from(format!("{header}{HEADING}{header:#}{lines}"))),
        None => command,
    };
    command.mut_subcommands(with_styled_examples)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn all(command: &clap::Command, found: &mut Vec<clap::Command>) {
        found.push(command.clone());
        command.get_subcommands().for_each(|command| all(command, found));
    }

    /// All commands and their own ones, but for `help`.
    fn commands() -> Vec<clap::Command> {
        let mut found = Vec::new();
        all(&command_line(), &mut found);
        found
    }

    #[test]
    fn the_declaration_holds_together() {
        command_line().debug_assert();
    }

    #[test]
    fn every_command_says_what_it_does_in_a_line() {
        for command in commands().iter().skip(1) {
            let about = command.get_about().map(ToString::to_string).unwrap_or_default();
            assert!(!about.is_empty(), "{}", command.get_name());
            assert!(about.chars().count() <= 84, "{}: {about}", command.get_name());
        }
    }

    #[test]
    fn every_command_stands_under_one_heading() {
        let named: Vec<String> = GROUPS
            .iter()
            .flat_map(|group| group.1)
            .map(|name| name.to_lowercase())
            .collect();
        let command = command_line();
        let known: Vec<&str> = command.get_subcommands().map(clap::Command::get_name).collect();
        assert_eq!(named, known);
    }

    #[test]
    fn examples_are_command_lines() {
        for command in commands()
            .iter()
            .filter(|command| !command.has_subcommands() || command.get_name() == PROGRAM)
        {
            let help = command.get_after_help().map(ToString::to_string).unwrap_or_default();
            let lines = help
                .strip_prefix(HEADING)
                .unwrap_or_default()
                .split("\n\n")
                .next()
                .unwrap_or_default();
            let lines: Vec<&str> = lines.lines().filter(|line| !line.is_empty()).collect();
            assert!((1..=3).contains(&lines.len()), "{}: {help}", command.get_name());
            for line in lines {
                let words = shlex::split(line).unwrap();
                // What a shell does with the output is its own.
                let words = words.into_iter().take_while(|word| word != "|" && word != ">");
                let words: Vec<OsString> = words.map(OsString::from).collect();
                let read = Cli::read(&words, ColorChoice::Never);
                let is_help = words.get(1).is_some_and(|word| word == "help");
                assert!(read.is_ok() || is_help, "{line}: {}", read.unwrap_err());
                assert!(line.starts_with("  deaflow ") && line.len() <= WIDTH, "{line}");
            }
        }
    }

    #[test]
    fn no_help_is_wider_than_it_may_be() {
        for mut command in commands() {
            let help = command.render_help().to_string();
            for line in help.lines() {
                assert!(line.chars().count() <= WIDTH, "{}: {line}", command.get_name());
            }
        }
    }

    #[test]
    fn the_list_of_commands_fits_a_narrow_terminal() {
        for width in [60, 80, 100] {
            let text = overview(&Cli::command(), width).to_string();
            let lines = text.lines().filter(|line| line.starts_with("  "));
            let mut words = String::new();
            for line in lines {
                assert!(line.chars().count() <= width, "{width}: {line}");
                words += line.trim_start();
                words += " ";
            }
            assert!(
                words.contains("so that others take it instead of building it"),
                "{words}"
            );
        }
    }

    #[test]
    fn the_colours_that_are_asked_for_are_known_before_all_else() {
        let found = |words: &str| colour_in(&words.split(' ').map(OsString::from).collect::<Vec<_>>());
        for (words, choice) in [
            ("deaflow run", ColorChoice::Auto),
            ("deaflow --color never run", ColorChoice::Never),
            ("deaflow run --color=always", ColorChoice::Always),
            ("deaflow run --color", ColorChoice::Auto),
            ("deaflow run --color pink", ColorChoice::Auto),
        ] {
            assert_eq!(found(words), choice, "{words}");
        }
    }
}
