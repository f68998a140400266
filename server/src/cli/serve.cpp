#include <fmt/core.h>
#include <fmt/ranges.h>
#include <malloc.h>
#include <spdlog/spdlog.h>

#include <cstdio>
#include <cstdlib>
#include <memory>
#include <mutex>
#include <stillmap/server/options_holder.hpp>
#include <stillmap/server/server.hpp>
#include <string>
#include <thread>
#include "blobs/blob_place.hpp"
#include "store/package_store.hpp"
#include "store/postgres_database.hpp"
#include "store/single_map_store.hpp"

#include "command_line/run_program.hpp"
#include "commands.hpp"
#include "config/config_text.hpp"
#include "config/option_table.hpp"
#include "config/reload.hpp"
#include "config/value_text.hpp"
#include "log/log_output.hpp"
#include "operation/health_probe.hpp"
#include "operation/notify.hpp"
#include "operation/startup_check.hpp"
#include "serve_signals.hpp"

namespace stillmap::cli {
namespace {

struct ServeArguments {
  std::string config;
  /// By key; those that the command line does not name stay out of `ConfigSources::flags`.
  std::map<std::string, std::string> values;
  std::map<std::string, const CLI::Option*> given;
  bool check = false;
  bool print_config = false;
  bool print_schema = false;
  bool print_page = false;
  /// Of a package that is served by itself.
  std::string map;
};

server::ConfigSources sources_of(const ServeArguments& arguments) {
  server::ConfigSources sources;
  sources.environment = server::own_environment();
  for (const auto& [key, option] : arguments.given) {
    if (option->count() > 0) sources.flags[key] = arguments.values.at(key);
  }
  const char* variable = std::getenv(std::string(server::kConfigVariable).c_str());
  if (!arguments.config.empty()) {
    sources.file = arguments.config;
  } else if (variable != nullptr && *variable != '\0') {
    sources.file = variable;
  }
  return sources;
}

/// One line each, as every error; then the usual exit code.
void require_none(const std::vector<server::ConfigProblem>& problems) {
  if (problems.empty()) return;
  for (const server::ConfigProblem& each : problems) {
    fmt::print(stderr, "stillmap: {}\n", each.text());
  }
  throw command_line::ExitCode{exit_code::kUsage};
}

/// @return whether its folder was made.
bool make_store(const std::string& store) {
  if (store.empty())
    throw std::invalid_argument(
        "nothing to serve: name a map package (stillmap serve MAP) or a store (--store DIR)");
  const std::string trouble = command_line::folder_or_new()(store);
  if (!trouble.empty()) throw std::invalid_argument("--store: " + trouble);
  return server::PackageStore::make_folder(store);
}

struct Reloaded {
  server::OptionsHolder& options;
  server::LogOutput& log;
  server::Server& server;
  const server::Notifier& notifier;
};

/// All that can fail comes before anything changes; the log file is last, since it may be made.
server::ReloadResult reload_parts(const server::ConfigSources& sources, const Reloaded& parts) {
  server::ConfigSources now = sources;
  now.environment = server::own_environment();
  return server::reload(
      now, parts.options,
      {[&](const server::ServerOptions&) { return parts.server.prepare_certificate(); },
       [&](const server::ServerOptions& next) { return parts.server.prepare_trust(next); },
       [&](const server::ServerOptions& next) {
         return [&server = parts.server, next] { server.reload(next); };
       },
       [&](const server::ServerOptions& next) { return parts.log.prepare(next.log); }});
}

void log_result(const server::ReloadResult& result) {
  for (const server::ConfigProblem& each : result.problems) {
    spdlog::error("configuration not reloaded: {}", each.text());
  }
  if (result.problems.empty()) {
    spdlog::info(
        "configuration reloaded, changed: {}",
        result.changed.empty() ? "nothing" : fmt::format("{}", fmt::join(result.changed, ", ")));
  }
  if (!result.need_restart.empty()) {
    spdlog::warn("these need a restart: {}", fmt::join(result.need_restart, ", "));
  }
}

/// A log that was rotated is closed, whatever is wrong with the rest.
void reopen_log(const Reloaded& parts) {
  try {
    parts.log.reopen(parts.options.current()->log);
  } catch (const std::exception& error) {
    spdlog::error("the log file cannot be opened again: {}", error.what());
  }
}

/// What SIGHUP does. Never throws: after any error the server goes on with its old configuration.
void reload_all(const server::ConfigSources& sources, const Reloaded& parts) {
  parts.notifier.reloading();
  bool well = false;
  try {
    const server::ReloadResult result = reload_parts(sources, parts);
    well = result.problems.empty();
    if (!well) reopen_log(parts);
    log_result(result);
  } catch (const std::exception& error) {
    reopen_log(parts);
    spdlog::error("configuration not reloaded, nothing has changed: {}", error.what());
  }
  parts.server.note_reload(well);
  parts.notifier.ready("configuration read again");
}

/// Only where a service manager wants to hear from this process.
std::unique_ptr<server::Watchdog> start_watchdog(const server::Notifier& notifier,
                                                 const server::ServerOptions& options, int port,
                                                 int management_port) {
  const auto interval = server::watchdog_interval();
  if (!notifier.listens() || !interval) return nullptr;
  const bool apart = management_port >= 0;
  if (options.tls.enabled() && !apart) {
    throw std::invalid_argument(
        "management.port: the watchdog asks without TLS, so it needs a management port; set one");
  }
  if (options.forwarded == "proxy" && !apart) {
    throw std::invalid_argument(
        "management.port: the watchdog asks without a PROXY header, so it needs a management port; "
        "set one");
  }
  // A quarter for the answer and a half between the questions stay within the interval.
  const auto timeout = std::chrono::duration_cast<std::chrono::milliseconds>(*interval / 4);
  return std::make_unique<server::Watchdog>(
      notifier, *interval,
      [host = apart ? options.management.host : options.host,
       asked = apart ? management_port : port, timeout] {
        const bool answers = server::answers_livez(host, asked, timeout);
        if (!answers) spdlog::warn("the server did not answer its own health check in time");
        return answers;
      });
}

/// @param single  the single map that is served; null where a store is served.
void run_server(const server::ConfigSources& sources, const server::ServerOptions& started,
                const server::SingleMapStore* single) {
  const bool made_store = single == nullptr && make_store(started.store);
  if (!started.state.empty())
    server::PackageStore::attach(started.store, server::PostgresAddress(started.state));
  // Waits for who restores it, while signals still end this process.
  {
    const server::PackageStore restored = single == nullptr
                                              ? server::open_store(started.store, started)
                                              : server::PackageStore(started.store);
  }
  SignalLoop::block();
  server::LogOutput log(started.log);
  if (made_store) spdlog::info("made the folder {} for a new store", started.store);
  const server::Notifier notifier = server::Notifier::of_process();
  server::OptionsHolder options(started);
  auto server = std::make_unique<server::Server>(
      started, started.store, find_beside("web", "share/stillmap/web"),
      single == nullptr ? server::StoreChanges::kTaken : server::StoreChanges::kRefused);
  const int port = server->bind();
  const std::string address =
      fmt::format("http{}://{}:{}/", started.tls.enabled() ? "s" : "", started.host, port);
  auto watchdog = start_watchdog(notifier, started, port, server->management_port());
  std::mutex draining;
  const SignalLoop signals({.reload =
                                [&] {
                                  reload_all(sources, {options, log, *server, notifier});
                                },
                            .drain =
                                [&] {
                                  spdlog::info("stopping in {} s", started.drain.delay_s);
                                  notifier.stopping("waiting for requests in hand");
                                  const std::scoped_lock lock(draining);
                                  server->drain();
                                  // The server itself cuts what takes too long; this is for what
                                  // hangs.
                                  constexpr int kGrace_s = 5;
                                  return std::chrono::seconds(started.drain.delay_s +
                                                              started.drain.timeout_s + kGrace_s);
                                }});
  const std::string served = single == nullptr
                                 ? started.store
                                 : fmt::format("{} as map {}, for reading only,",
                                               single->package().string(), single->map());
  spdlog::info("stillmap {} serves {} at {}", STILLMAP_VERSION, served, address);
  // stdout carries the address and nothing else.
  fmt::print("listening on {}\n", address);
  std::fflush(stdout);
  notifier.ready("listening on " + address);
  server->run();
  // Its threads end while a second signal, and time, still count: one may be loading a large map.
  { const std::scoped_lock lock(draining); }
  watchdog.reset();
  server.reset();
  spdlog::info("stopped");
}

/// Two heaps for each core. By default glibc takes eight, and with a thread for each connection
/// each of them ends up with memory for a scan of its own.
void bound_heaps() {
  mallopt(M_ARENA_MAX, 2 * static_cast<int>(std::thread::hardware_concurrency()));
}

void check_files(const server::ResolvedConfig& config) {
  require_none(server::problems_of_files(config));
  fmt::print("the configuration can be used\n");
}

/// As if `--store` named the temporary store.
void serve_map(const std::string& map, server::ConfigSources sources,
               server::ServerOptions options) {
  if (!options.store.empty())
    throw std::invalid_argument(
        fmt::format("the map {} and the store {} cannot both be served; leave out MAP, or leave "
                    "out --store and "
                    "the configuration's store",
                    map, options.store));
  if (!options.blobs.empty())
    throw std::invalid_argument("blobs: a map that is served by itself is in its folder; leave " +
                                options.blobs + " out");
  const server::SingleMapStore single(map);
  sources.flags["store"] = single.folder().string();
  options.store = single.folder().string();
  run_server(sources, options, &single);
}

void serve(const ServeArguments& arguments) {
  if (arguments.print_schema) return fmt::print("{}", server::config_schema());
  if (arguments.print_page) return fmt::print("{}", server::config_page());
  const server::ConfigSources sources = sources_of(arguments);
  const server::ResolvedConfig config = server::resolve(sources);
  require_none(config.problems);
  if (arguments.print_config) return fmt::print("{}", server::config_listing(config));
  if (arguments.check) return check_files(config);
  bound_heaps();
  if (!arguments.map.empty()) return serve_map(arguments.map, sources, config.options);
  run_server(sources, config.options, nullptr);
}

void add_option(CLI::App& command, const server::Option& option, ServeArguments& arguments) {
  const std::string key(option.key);
  std::string& value = arguments.values[key];
  const std::string text = fmt::format("{} {}; default {}", option.text, option.expected(),
                                       server::value_text(option.get(server::ServerOptions{})));
  CLI::Option* added = option.kind() == server::OptionKind::kFlag
                           ? command.add_flag(option.flag(), value, text)
                           : command.add_option(option.flag(), value, text);
  const std::size_t dot = key.find('.');
  if (dot != std::string::npos) added->group("Options of " + key.substr(0, dot));
  arguments.given[key] = added;
}

}  // namespace

void add_serve(CLI::App& app) {
  auto arguments = std::make_shared<ServeArguments>();
  CLI::App* command = app.add_subcommand("serve", "Serve one map, or a store of maps, over HTTP");
  command
      ->add_option("MAP", arguments->map,
                   "Folder of one map package to serve without a store, for reading only: poses, "
                   "tiles and the page. Its index is written into the folder. Uploads, rebuilds "
                   "and keys need --store")
      ->type_name("FOLDER");
  command
      ->add_option("--config", arguments->config,
                   "Configuration file, JSON with comments (default: the file that " +
                       std::string(server::kConfigVariable) + " names)")
      ->type_name("FILE");
  command->add_flag("--check", arguments->check,
                    "Print everything that is wrong with the configuration, and end");
  command->add_flag("--print-config", arguments->print_config,
                    "Print the values in use and where each comes from, and end");
  command->add_flag("--print-schema", arguments->print_schema,
                    "Print the JSON Schema of the configuration file, and end");
  command->add_flag("--print-page", arguments->print_page,
                    "Print the page that documents all options, and end");
  for (const server::Option& option : server::all_options()) {
    add_option(*command, option, *arguments);
  }
  command->callback([arguments] { serve(*arguments); });
}

}  // namespace stillmap::cli
