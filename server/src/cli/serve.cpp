#include <fmt/core.h>
#include <pthread.h>
#include <spdlog/sinks/stdout_color_sinks.h>
#include <spdlog/spdlog.h>

#include <csignal>
#include <cstdio>
#include <memory>
#include <stillmap/server/server.hpp>
#include <string>
#include <thread>

#include "command_line/run_program.hpp"
#include "commands.hpp"

namespace stillmap::cli {
namespace {

struct ServeArguments {
  std::filesystem::path store;
  server::ServerOptions options;
  std::string log_level = "info";
};

/// Waits for SIGINT or SIGTERM on a thread of its own: what a server needs to stop may not be
/// called from a handler.
class SignalWatch {
 public:
  /// Call before any other thread starts, so that all of them leave these signals to this one.
  SignalWatch() {
    sigemptyset(&signals_);
    for (const int signal : {SIGINT, SIGTERM, SIGUSR1}) sigaddset(&signals_, signal);
    pthread_sigmask(SIG_BLOCK, &signals_, nullptr);
  }
  void stop_on_signal(server::Server& server) {
    thread_ = std::thread([this, &server] {
      int signal = 0;
      sigwait(&signals_, &signal);
      if (signal != SIGUSR1) spdlog::info("stopping");
      server.stop();
    });
  }
  SignalWatch(const SignalWatch&) = delete;
  SignalWatch& operator=(const SignalWatch&) = delete;
  ~SignalWatch() {
    if (!thread_.joinable()) return;
    pthread_kill(thread_.native_handle(), SIGUSR1);
    thread_.join();
  }

 private:
  sigset_t signals_{};
  std::thread thread_;
};

void serve(const ServeArguments& arguments) {
  // stdout carries the address and nothing else.
  spdlog::set_default_logger(spdlog::stderr_color_mt("stillmap"));
  spdlog::set_level(spdlog::level::from_str(arguments.log_level));
  SignalWatch signals;
  server::Server server(arguments.options, arguments.store,
                        find_beside("web", "share/stillmap/web"));
  const int port = server.bind();
  signals.stop_on_signal(server);
  fmt::print("listening on http://{}:{}/\n", arguments.options.host, port);
  std::fflush(stdout);
  server.run();
}

}  // namespace

void add_serve(CLI::App& app) {
  auto arguments = std::make_shared<ServeArguments>();
  server::ServerOptions& options = arguments->options;
  CLI::App* command =
      app.add_subcommand("serve", "Serve a folder of maps over HTTP (see server/README.md)");
  command->add_option("--store", arguments->store, "Folder with a map package in each sub-folder")
      ->required()
      ->check(command_line::existing_folder());
  command->add_option("--host", options.host, "Address to listen on")->capture_default_str();
  command->add_option("--port", options.port, "Port to listen on; 0 takes any free one")
      ->capture_default_str();
  command->add_flag("--allow-remote", options.allow_remote,
                    "Let --host be an address that other machines reach; there are no keys yet");
  command->add_option("--max-payload", options.max_payload_bytes, "Largest request body [bytes]")
      ->capture_default_str();
  command->add_option("--workers", options.workers, "Alignments at one time; 0 = as many as cores")
      ->capture_default_str();
  command
      ->add_option("--queue", options.queue,
                   "Requests that may wait for a worker; beyond it the answer is 503")
      ->capture_default_str();
  command->add_option("--connections", options.connections, "Connections served at one time")
      ->capture_default_str();
  command->add_option("--log-level", arguments->log_level, "debug also logs every request")
      ->capture_default_str()
      ->check(CLI::IsMember({"debug", "info", "warning", "error"}));
  command->callback([arguments] { serve(*arguments); });
}

}  // namespace stillmap::cli
