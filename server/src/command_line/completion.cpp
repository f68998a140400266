#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <map>
#include <string_view>

#include "command_line/command_text.hpp"
#include "command_line/command_tree.hpp"

namespace stillmap::command_line {
namespace {

/// `case "$command WORD" in ... esac`, which both shells read alike: each body with all of its
/// patterns.
class CaseStatement {
 public:
  void add(const std::string& pattern, const std::string& body) {
    patterns_[body].push_back(shell_word(pattern));
  }
  [[nodiscard]] std::string text(std::string_view subject) const {
    std::string text = fmt::format("  case \"{}\" in\n", subject);
    for (const auto& [body, patterns] : patterns_)
      text += fmt::format("    {})\n      {} ;;\n", fmt::join(patterns, " | \\\n    "), body);
    return text + "  esac\n";
  }

 private:
  std::map<std::string, std::vector<std::string>> patterns_;
};

std::string joined(const std::vector<std::string>& words) {
  return fmt::format("{}", fmt::join(words, " "));
}

/// Sets `kind` and `choices`; nothing where anything may be typed.
std::string body_of(const CommandEntry::Value& value) {
  if (!value.choices.empty())
    return fmt::format("kind=words choices={}", shell_word(joined(value.choices)));
  switch (value.kind) {
    case ValueKind::kFile:
      return "kind=files";
    case ValueKind::kFolder:
      return "kind=folders";
    case ValueKind::kText:
    case ValueKind::kNumber:
      return "kind=none";
    case ValueKind::kNone:
      break;
  }
  return {};
}

/// Steps `command` down when a word names a command below it.
CaseStatement descents(const std::vector<CommandEntry>& tree) {
  CaseStatement descent;
  for (const CommandEntry& entry : tree)
    if (entry.name.find(' ') != std::string::npos) descent.add(entry.name, "command+=\" $word\"");
  return descent;
}

/// What the value of the option before the word may be; an option behind `=` ends in it here.
CaseStatement values(const std::vector<CommandEntry>& tree) {
  CaseStatement value;
  for (const CommandEntry& entry : tree) {
    for (const CommandEntry::Option& option : entry.options) {
      const std::string body = body_of(option.value);
      if (body.empty()) continue;
      for (const std::string& name : option.names) {
        if (!option.only_assigned) value.add(entry.name + " " + name, body);
        value.add(entry.name + " " + name + "=", body);
      }
    }
  }
  return value;
}

/// What may be typed without an option before it: a command, or an argument of any place.
CaseStatement words(const std::vector<CommandEntry>& tree) {
  CaseStatement word;
  for (const CommandEntry& entry : tree) {
    CommandEntry::Value all{ValueKind::kText, {}};
    for (const CommandEntry& each : tree)
      if (each.name.starts_with(entry.name + " ") &&
          each.name.find(' ', entry.name.size() + 1) == std::string::npos)
        all.choices.push_back(each.name.substr(entry.name.size() + 1));
    for (const CommandEntry::Value& argument : entry.arguments) {
      all.choices.insert(all.choices.end(), argument.choices.begin(), argument.choices.end());
      // A file may lie in a folder, so that files win.
      if (argument.kind == ValueKind::kFile || all.kind == ValueKind::kText)
        all.kind = argument.kind;
    }
    word.add(entry.name, body_of(all));
  }
  return word;
}

CaseStatement option_names(const std::vector<CommandEntry>& tree) {
  CaseStatement names;
  for (const CommandEntry& entry : tree) {
    std::vector<std::string> all;
    for (const CommandEntry::Option& option : entry.options)
      all.insert(all.end(), option.names.begin(), option.names.end());
    names.add(entry.name, "kind=words choices=" + shell_word(joined(all)));
  }
  return names;
}

/// Sets `kind` and `choices` by `command`, `previous` and `current`.
std::string lookup(const std::vector<CommandEntry>& tree) {
  return "  local kind= choices=\n" + values(tree).text("$command $previous") +
         "  if [[ -z $kind && $current == -* ]]; then\n" + option_names(tree).text("$command") +
         "  elif [[ -z $kind ]]; then\n" + words(tree).text("$command") + "  fi\n";
}

}  // namespace

std::string bash_completion(const std::vector<CommandEntry>& tree) {
  return "# Completion of stillmap for bash, made by `stillmap completion bash`.\n"
         "_stillmap() {\n"
         "  local command=stillmap word i\n"
         "  local current=${COMP_WORDS[COMP_CWORD]} previous=${COMP_WORDS[COMP_CWORD - 1]}\n"
         "  # To bash, --json=FILE is three words.\n"
         "  if [[ $current == '=' ]]; then\n"
         "    current= previous+='='\n"
         "  elif [[ $previous == '=' ]]; then\n"
         "    previous=${COMP_WORDS[COMP_CWORD - 2]}=\n"
         "  fi\n"
         "  for ((i = 1; i < COMP_CWORD; i++)); do\n"
         "    word=${COMP_WORDS[i]}\n" +
         descents(tree).text("$command $word") + "  done\n" + lookup(tree) +
         "  COMPREPLY=()\n"
         "  case $kind in\n"
         "    words) mapfile -t COMPREPLY < <(compgen -W \"$choices\" -- \"$current\") ;;\n"
         "    files) compopt -o filenames 2>/dev/null\n"
         "      mapfile -t COMPREPLY < <(compgen -f -- \"$current\") ;;\n"
         "    folders) compopt -o filenames 2>/dev/null\n"
         "      mapfile -t COMPREPLY < <(compgen -d -- \"$current\") ;;\n"
         "  esac\n"
         "}\n"
         "complete -F _stillmap stillmap\n";
}

std::string zsh_completion(const std::vector<CommandEntry>& tree) {
  return "#compdef stillmap\n"
         "# Completion of stillmap for zsh, made by `stillmap completion zsh`.\n"
         "_stillmap() {\n"
         "  local command=stillmap word\n"
         "  local current=${words[CURRENT]} previous=${words[CURRENT-1]}\n"
         "  # To zsh, --json=FILE is one word.\n"
         "  if [[ $current == --*=* ]]; then\n"
         "    previous=${current%%=*}=\n"
         "    compset -P '*='\n"
         "  fi\n"
         "  for word in \"${(@)words[2,CURRENT-1]}\"; do\n" +
         descents(tree).text("$command $word") + "  done\n" + lookup(tree) +
         "  case $kind in\n"
         "    words) compadd -- ${(s: :)choices} ;;\n"
         "    files) _files ;;\n"
         "    folders) _files -/ ;;\n"
         "  esac\n"
         "}\n"
         "if [[ $funcstack[1] == _stillmap ]]; then _stillmap \"$@\"; else compdef _stillmap "
         "stillmap; fi\n";
}

}  // namespace stillmap::command_line
