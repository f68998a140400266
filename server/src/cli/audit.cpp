#include "blobs/blob_place.hpp"
#include "store/package_store.hpp"

#include <fmt/core.h>

#include <memory>
#include <string>

#include "bodies/audit_json.hpp"
#include "command_line/result_output.hpp"
#include "command_line/run_program.hpp"
#include "commands.hpp"

namespace stillmap::cli {
namespace {

struct AuditArguments {
  std::filesystem::path store;
  command_line::JsonOutput json;
};

std::string text_of(const server::AuditLog::Check& check) {
  if (check.first_wrong_id)
    return fmt::format(
        "record {} does not fit the record before it: one of them was changed or removed; compare "
        "with an earlier `stillmap audit export` or a backup",
        *check.first_wrong_id);
  return fmt::format("all {} records fit together; the newest is {} with SHA-256 {}", check.records,
                     check.newest_id, check.newest_sha256);
}

void verify(const AuditArguments& arguments) {
  require_store(arguments.store);
  server::PackageStore store = server::open_store(arguments.store);
  const server::AuditLog::Check check = store.audit().check();
  arguments.json.write(server::audit_check_json(check));
  if (!arguments.json.replaces_text()) fmt::print("{}\n", text_of(check));
  if (check.first_wrong_id) throw command_line::ExitCode{exit_code::kFailed};
}

void export_lines(const AuditArguments& arguments) {
  require_store(arguments.store);
  server::PackageStore store = server::open_store(arguments.store);
  store.audit().for_each([](const server::AuditRecord& record, const std::string& before) {
    fmt::print("{}\n", server::audit_line(record, before));
  });
}

}  // namespace

void add_audit(CLI::App& app) {
  auto arguments = std::make_shared<AuditArguments>();
  CLI::App* group = app.add_subcommand("audit", "Check or export the audit log of a store");
  group->require_subcommand(1);
  const auto add = [&](const char* name, const char* help, void (*run)(const AuditArguments&)) {
    CLI::App* command = group->add_subcommand(name, help);
    command->add_option("--store", arguments->store, "Folder of the store")
        ->required()
        ->check(command_line::existing_folder());
    command->callback([arguments, run] { run(*arguments); });
    return command;
  };
  arguments->json.add_to(
      *add("verify",
           "Recompute the chain of the audit log; exit code 1 when a record does "
           "not fit",
           verify));
  add("export", "Print all records, oldest first, one JSON object a line", export_lines);
}

}  // namespace stillmap::cli
