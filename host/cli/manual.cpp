#include "host/cli/manual.h"

#include <algorithm>
#include <cctype>
#include <fstream>
#include <functional>
#include <memory>
#include <stdexcept>
#include <vector>

namespace ivfm::host {
namespace {

namespace fs = std::filesystem;

constexpr const char* kHiddenGroup = "";

std::vector<const CLI::App*> subcommands(const CLI::App& app) {
  return app.get_subcommands([](const CLI::App* sub) { return sub->get_group() != kHiddenGroup; });
}

std::vector<const CLI::Option*> options(const CLI::App& app, bool positional) {
  std::vector<const CLI::Option*> out;
  for (const CLI::Option* option : app.get_options()) {
    if (option->get_group() != kHiddenGroup && option->get_positional() == positional) {
      out.push_back(option);
    }
  }
  return out;
}

// "-o", "--output" as they are typed.
std::vector<std::string> spellings(const CLI::Option& option) {
  std::vector<std::string> names;
  for (const std::string& name : option.get_snames()) names.push_back("-" + name);
  for (const std::string& name : option.get_lnames()) names.push_back("--" + name);
  return names;
}

bool takes_value(const CLI::Option& option) { return option.get_items_expected_max() > 0; }

// The words that may follow, where the option says so ("TEXT:{a,b}"); else none.
std::vector<std::string> choices(const CLI::Option& option) {
  const std::string type = option.get_type_name();
  const std::size_t begin = type.find('{'), end = type.rfind('}');
  std::vector<std::string> out;
  if (begin == std::string::npos || end == std::string::npos || end < begin) return out;
  for (std::size_t at = begin + 1; at < end;) {
    const std::size_t comma = std::min(type.find(',', at), end);
    out.push_back(type.substr(at, comma - at));
    at = comma + 1;
  }
  return out;
}

std::string joined(const std::vector<std::string>& words, const char* between = " ") {
  std::string text;
  for (const std::string& word : words) text += (text.empty() ? "" : between) + word;
  return text;
}

// Calls `visit(command, words)` for the root and everything below; words: "ivfm log report".
void walk(const CLI::App& app, const std::string& words,
          const std::function<void(const CLI::App&, const std::string&)>& visit) {
  visit(app, words);
  for (const CLI::App* sub : subcommands(app)) walk(*sub, words + " " + sub->get_name(), visit);
}

// --- Man pages ---

// Text that roff takes as it is.
std::string roff(const std::string& text) {
  std::string out;
  bool line_begins = true;
  for (const char c : text) {
    if (line_begins && (c == '.' || c == '\'')) out += "\\&";
    if (c == '\\') {
      out += "\\e";
    } else if (c == '-') {
      out += "\\-";
    } else {
      out += c;
    }
    line_begins = c == '\n';
  }
  return out;
}

std::string value_name(const CLI::Option& option) {
  const std::vector<std::string> words = choices(option);
  if (!words.empty()) return joined(words, "|");
  const std::string type = option.get_type_name();
  return type.substr(0, type.find_first_of(":[ "));
}

std::string option_entry(const CLI::Option& option) {
  std::string head;
  for (const std::string& name : spellings(option)) {
    head += (head.empty() ? "" : ", ") + std::string("\\fB") + roff(name) + "\\fR";
  }
  if (head.empty()) head = "\\fI" + roff(option.get_name(true)) + "\\fR";
  if (takes_value(option) && !option.get_positional()) {
    head += " \\fI" + roff(value_name(option)) + "\\fR";
  }
  std::string text = roff(option.get_description());
  if (!option.get_default_str().empty()) text += " [" + roff(option.get_default_str()) + "]";
  return ".TP\n" + head + "\n" + (text.empty() ? "\\&" : text) + "\n";
}

std::string synopsis(const CLI::App& command, const std::string& words) {
  std::string text = "\\fB" + roff(words) + "\\fR";
  if (!options(command, false).empty()) text += " [\\fIoptions\\fR]";
  for (const CLI::Option* option : options(command, true)) {
    text += " \\fI" + roff(option->get_name(true)) + "\\fR";
  }
  if (!subcommands(command).empty()) text += " \\fIcommand\\fR ...";
  return text;
}

// "ivfm log report" is told in ivfm-log-report(1).
std::string page_name(std::string words) {
  std::replace(words.begin(), words.end(), ' ', '-');
  return words;
}

// --- Completions ---

std::vector<std::string> words_after(const CLI::App& command) {
  std::vector<std::string> words;
  for (const CLI::App* sub : subcommands(command)) words.push_back(sub->get_name());
  for (const CLI::Option* option : options(command, false)) {
    for (const std::string& name : spellings(*option)) words.push_back(name);
  }
  return words;
}

// For single quotes and _arguments' brackets.
std::string zsh_text(const std::string& text) {
  std::string out;
  for (const char c : text) {
    if (c == '\'') {
      out += "'\\''";
    } else if (c == '[' || c == ']' || c == ':' || c == '\\') {
      out += std::string("\\") + c;
    } else {
      out += c == '\n' ? ' ' : c;
    }
  }
  return out;
}

std::string zsh_option(const CLI::Option& option) {
  const std::vector<std::string> names = spellings(option);
  std::string text;
  for (const std::string& name : names) {
    text += "    '";
    if (names.size() > 1) text += "(" + joined(names) + ")";
    text += name + "[" + zsh_text(option.get_description()) + "]";
    if (takes_value(option)) {
      const std::vector<std::string> words = choices(option);
      text += ":value:" + (words.empty() ? std::string("_files") : "(" + joined(words) + ")");
    }
    text += "' \\\n";
  }
  return text;
}

std::string function_name(std::string words) {
  for (char& c : words) {
    if (c == ' ' || c == '-') c = '_';
  }
  return "_" + words;
}

std::string zsh_function(const CLI::App& command, const std::string& words) {
  const auto subs = subcommands(command);
  std::string text = function_name(words) + "() {\n  local state line\n  _arguments -C \\\n";
  for (const CLI::Option* option : options(command, false)) text += zsh_option(*option);
  if (subs.empty()) return text + "    '*:file:_files'\n}\n";
  text +=
      "    '1:command:->command' '*::argument:->argument'\n  case $state in\n    command)\n"
      "      local -a commands=(\n";
  for (const CLI::App* sub : subs) {
    text += "        '" + sub->get_name() + ":" + zsh_text(sub->get_description()) + "'\n";
  }
  text += "      )\n      _describe command commands ;;\n    argument)\n      case $line[1] in\n";
  for (const CLI::App* sub : subs) {
    text += "        " + sub->get_name() + ") " + function_name(words + " " + sub->get_name()) +
            " ;;\n";
  }
  return text + "      esac ;;\n  esac\n}\n";
}

void write_file(const fs::path& path, const std::string& text) {
  std::error_code error;
  fs::create_directories(path.parent_path(), error);
  std::ofstream out(path);
  out << text;
  out.close();
  if (!out) throw std::runtime_error("'" + path.string() + "' cannot be written");
}

}  // namespace

std::string man_page(const CLI::App& command, const std::string& words) {
  const std::string name = page_name(words);
  std::string upper = name;
  std::transform(upper.begin(), upper.end(), upper.begin(),
                 [](unsigned char c) { return static_cast<char>(std::toupper(c)); });
  // A root's description begins with its name.
  std::string what = command.get_description();
  if (what.starts_with(name + ": ")) what.erase(0, name.size() + 2);
  std::string page = ".TH " + upper + " 1 \"\" ivfm \"ivfm manual\"\n.SH NAME\n" + roff(name) +
                     " \\- " + roff(what) + "\n.SH SYNOPSIS\n" + synopsis(command, words) + "\n";
  const auto subs = subcommands(command);
  if (!subs.empty()) {
    page += ".SH COMMANDS\n";
    for (const CLI::App* sub : subs) {
      page += ".TP\n\\fB" + roff(name + "-" + sub->get_name()) + "\\fR(1)\n" +
              roff(sub->get_description()) + "\n";
    }
  }
  for (const bool positional : {true, false}) {
    const auto list = options(command, positional);
    if (list.empty()) continue;
    page += positional ? ".SH ARGUMENTS\n" : ".SH OPTIONS\n";
    for (const CLI::Option* option : list) page += option_entry(*option);
  }
  if (!command.get_footer().empty()) {
    page += ".SH EXAMPLE\n.nf\n" + roff(command.get_footer()) + "\n.fi\n";
  }
  return page + ".SH EXIT STATUS\n0: done. 1: failed; stderr says why. 2: wrong usage.\n";
}

std::string bash_completion(const CLI::App& root) {
  const std::string name = root.get_name();
  std::string paths, values, words;
  walk(root, name, [&](const CLI::App& command, const std::string& path) {
    if (path != name) paths += (paths.empty() ? "" : "|") + std::string("\"") + path + "\"";
    words += "    \"" + path + "\") words=\"" + joined(words_after(command)) + "\" ;;\n";
    for (const CLI::Option* option : options(command, false)) {
      if (!takes_value(*option)) continue;
      for (const std::string& spelling : spellings(*option)) {
        values += "    \"" + path + " " + spelling + "\") words=\"" + joined(choices(*option)) +
                  "\"; value=1 ;;\n";
      }
    }
  });
  return "# Completion of " + name + " for bash; written by '" + name + " manual'.\n_" + name +
         "() {\n"
         "  local cur=${COMP_WORDS[COMP_CWORD]} path=" +
         name +
         " words= value= i\n"
         "  for ((i = 1; i < COMP_CWORD; ++i)); do\n"
         "    case \"$path ${COMP_WORDS[i]}\" in\n      " +
         paths +
         ") path+=\" ${COMP_WORDS[i]}\" ;;\n    esac\n  done\n"
         "  case \"$path ${COMP_WORDS[COMP_CWORD-1]}\" in\n" +
         values +
         "  esac\n"
         "  [[ $value ]] || case \"$path\" in\n" +
         words +
         "  esac\n"
         "  COMPREPLY=($(compgen -W \"$words\" -- \"$cur\"))\n}\n"
         "complete -o default -F _" +
         name + " " + name + "\n";
}

std::string zsh_completion(const CLI::App& root) {
  std::string text =
      "#compdef " + root.get_name() + "\n# Written by '" + root.get_name() + " manual'.\n";
  walk(root, root.get_name(), [&](const CLI::App& command, const std::string& words) {
    text += zsh_function(command, words);
  });
  return text + function_name(root.get_name()) + " \"$@\"\n";
}

void write_manual(const CLI::App& root, const fs::path& folder) {
  const std::string name = root.get_name();
  walk(root, name, [&](const CLI::App& command, const std::string& words) {
    write_file(folder / "share/man/man1" / (page_name(words) + ".1"), man_page(command, words));
  });
  write_file(folder / "share/bash-completion/completions" / name, bash_completion(root));
  write_file(folder / "share/zsh/site-functions" / ("_" + name), zsh_completion(root));
}

void add_manual_command(CLI::App& app, CommandAction& action,
                        std::function<void(const ShowCommandLine&)> show_other) {
  auto folder = std::make_shared<fs::path>();
  CLI::App* command = app.add_subcommand("manual", "Write man pages and shell completions");
  command->group(kHiddenGroup);
  command->add_option("folder", *folder, "where share/ is to appear")->required();
  command->footer("Example: " + app.get_name() + " manual /usr/local");
  command->callback([&app, folder, &action, show_other = std::move(show_other)] {
    action = [&app, folder, show_other] {
      const ShowCommandLine write = [&](const CLI::App& root) { write_manual(root, *folder); };
      write(app);
      if (show_other) show_other(write);
      return 0;
    };
  });
}

}  // namespace ivfm::host
