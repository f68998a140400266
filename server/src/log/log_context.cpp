#include "log_context.hpp"

#include <utility>

namespace stillmap::server {
namespace {

thread_local const LogContext* current = nullptr;

}  // namespace

LogScope::LogScope(LogContext context)
    : context_(std::move(context)), before_(std::exchange(current, &context_)) {}
LogScope::~LogScope() { current = before_; }

const LogContext* current_log_context() { return current; }

}  // namespace stillmap::server
