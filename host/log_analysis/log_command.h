// `ivfm log`: what a run's database tells, as report, picture, film, figures, table or time line.
#pragma once

#include <filesystem>
#include <iosfwd>
#include <string>

#include "host/cli/commands.h"
#include "host/log_analysis/run_data.h"

namespace ivfm::host {

// All throw std::runtime_error with one sentence when `database` is no run database or an output
// cannot be written. What of a damaged one cannot be read they tell on stderr.

// One self-contained HTML page.
void write_log_report(const std::filesystem::path& database, const std::filesystem::path& html);
void write_log_map(const std::filesystem::path& database, const std::filesystem::path& png);
// A table of what `sql` yields. Nothing in the file can be changed.
void print_query(const std::filesystem::path& database, const std::string& sql, std::ostream& out);
void print_timeline(const std::filesystem::path& database, std::ostream& out);

// On stderr, a line each.
void tell(const std::filesystem::path& database, const Warnings& warnings);

// Adds the subcommand.
void add_log_command(CLI::App& app, CommandAction& action);

}  // namespace ivfm::host
