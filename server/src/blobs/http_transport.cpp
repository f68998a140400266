#include "blobs/http_transport.hpp"

#include <algorithm>
#include <array>
#include <condition_variable>
#include <exception>
#include <mutex>
#include <stdexcept>
#include <utility>

#include "blobs/curl_library.hpp"

namespace stillmap::server {
namespace {

/// Of all headers together; more than that is no answer of a storage server.
constexpr std::size_t kMostReplyHeaderBytes = 256U << 10U;

const CurlLibrary& curl() { return CurlLibrary::get(); }

/// What a call needs while libcurl calls back. Exceptions must not pass through libcurl's C.
struct Transfer {
  const HttpCall& call;
  const std::atomic<bool>& stopped;
  CURL* handle;
  HttpReply reply{};
  std::uint64_t sent = 0;
  std::size_t header_bytes = 0;
  std::exception_ptr thrown{};
};

std::size_t give_body(char* into, std::size_t size, std::size_t count, void* user) {
  auto& transfer = *static_cast<Transfer*>(user);
  try {
    const std::uint64_t left = transfer.call.body_bytes - transfer.sent;
    const std::size_t most = std::min<std::uint64_t>(left, size * count);
    const std::size_t got =
        most == 0 ? 0 : transfer.call.body(transfer.sent, std::span(into, most));
    transfer.sent += got;
    return got;
  } catch (...) {
    transfer.thrown = std::current_exception();
    return CURL_READFUNC_ABORT;
  }
}

int seek_body(void* user, curl_off_t offset, int origin) {
  if (origin != SEEK_SET) return CURL_SEEKFUNC_CANTSEEK;
  static_cast<Transfer*>(user)->sent = static_cast<std::uint64_t>(offset);
  return CURL_SEEKFUNC_OK;
}

std::size_t take_body(char* bytes, std::size_t size, std::size_t count, void* user) {
  auto& transfer = *static_cast<Transfer*>(user);
  try {
    long status = 0;
    curl().easy_getinfo(transfer.handle, CURLINFO_RESPONSE_CODE, &status);
    if (transfer.call.take)
      transfer.call.take(static_cast<int>(status), std::string_view(bytes, size * count));
    return size * count;
  } catch (...) {
    transfer.thrown = std::current_exception();
    return 0;
  }
}

std::size_t take_header(char* bytes, std::size_t size, std::size_t count, void* user) {
  auto& transfer = *static_cast<Transfer*>(user);
  const std::string_view line(bytes, size * count);
  transfer.header_bytes += line.size();
  if (transfer.header_bytes > kMostReplyHeaderBytes) return 0;
  // Those of `100 Continue` come first.
  if (line.starts_with("HTTP/")) transfer.reply.headers.clear();
  const std::size_t colon = line.find(':');
  if (colon == line.npos) return line.size();
  std::string name(line.substr(0, colon));
  std::ranges::transform(name, name.begin(), [](char c) {
    return c >= 'A' && c <= 'Z' ? static_cast<char>(c - 'A' + 'a') : c;
  });
  std::string_view value = line.substr(colon + 1);
  const std::size_t begin = value.find_first_not_of(" \t\r\n");
  value = begin == value.npos ? std::string_view() : value.substr(begin);
  value = value.substr(0, value.find_last_not_of(" \t\r\n") + 1);
  transfer.reply.headers.insert_or_assign(std::move(name), std::string(value));
  return line.size();
}

int go_on(void* user, curl_off_t, curl_off_t, curl_off_t, curl_off_t) {
  return static_cast<Transfer*>(user)->stopped ? 1 : 0;
}

bool may_pass_later(CURLcode code) {
  constexpr std::array kTransient = {CURLE_COULDNT_RESOLVE_HOST, CURLE_COULDNT_CONNECT,
                                     CURLE_OPERATION_TIMEDOUT,   CURLE_SEND_ERROR,
                                     CURLE_RECV_ERROR,           CURLE_GOT_NOTHING,
                                     CURLE_PARTIAL_FILE,         CURLE_SSL_CONNECT_ERROR,
                                     CURLE_WEIRD_SERVER_REPLY,   CURLE_SEND_FAIL_REWIND};
  return std::ranges::find(kTransient, code) != kTransient.end();
}

/// What differs between methods.
void set_method(CURL* handle, const HttpCall& call) {
  if (call.method == "HEAD") {
    curl().easy_setopt(handle, CURLOPT_NOBODY, 1L);
  } else if (call.method == "PUT") {
    curl().easy_setopt(handle, CURLOPT_UPLOAD, 1L);
    curl().easy_setopt(handle, CURLOPT_INFILESIZE_LARGE, static_cast<curl_off_t>(call.body_bytes));
  } else if (call.method == "POST") {
    curl().easy_setopt(handle, CURLOPT_POST, 1L);
    curl().easy_setopt(handle, CURLOPT_POSTFIELDSIZE_LARGE,
                       static_cast<curl_off_t>(call.body_bytes));
  } else if (call.method == "DELETE") {
    curl().easy_setopt(handle, CURLOPT_CUSTOMREQUEST, "DELETE");
  }
}

}  // namespace

/// Handles that are not in use. Each keeps its connection.
struct HttpTransport::Pool {
  std::mutex mutex;
  std::condition_variable freed;
  std::vector<CURL*> idle;
  std::size_t in_use = 0;

  ~Pool() {
    for (CURL* handle : idle) curl().easy_cleanup(handle);
  }
  CURL* take(std::size_t most) {
    std::unique_lock lock(mutex);
    freed.wait(lock, [&] { return in_use < most; });
    CURL* handle = nullptr;
    if (idle.empty()) {
      handle = curl().easy_init();
      if (handle == nullptr) throw std::runtime_error("libcurl cannot make a connection");
    } else {
      handle = idle.back();
      idle.pop_back();
    }
    ++in_use;
    return handle;
  }
  void give_back(CURL* handle) {
    // Options go, connections and TLS sessions stay.
    curl().easy_reset(handle);
    const std::scoped_lock lock(mutex);
    idle.push_back(handle);
    --in_use;
    freed.notify_one();
  }
};

HttpTransport::HttpTransport(const HttpTransportOptions& options) : options_(options) {
  (void)CurlLibrary::get();
  pool_ = std::make_unique<Pool>();
}

HttpTransport::~HttpTransport() = default;

void HttpTransport::stop() { stopped_ = true; }

bool HttpTransport::is_stopped() const { return stopped_; }

HttpReply HttpTransport::perform(const HttpCall& call) {
  if (stopped_) return {.failure = "the program ends"};
  CURL* const handle = pool_->take(options_.connections);
  const auto give_back = [this](CURL* used) { pool_->give_back(used); };
  const std::unique_ptr<CURL, decltype(give_back)> lease(handle, give_back);
  std::unique_ptr<curl_slist, decltype(CurlLibrary::slist_free_all)> headers(nullptr,
                                                                             curl().slist_free_all);
  const auto add_header = [&](const char* line) {
    curl_slist* const longer = curl().slist_append(headers.get(), line);
    if (longer == nullptr) throw std::bad_alloc();
    (void)headers.release();
    headers.reset(longer);
  };
  for (const std::string& line : call.headers) add_header(line.c_str());
  // What libcurl would add by itself.
  if (call.method == "POST") add_header("Content-Type:");

  Transfer transfer{call, stopped_, handle};
  std::array<char, CURL_ERROR_SIZE> reason{};
  const auto set = [&](CURLoption option, auto value) {
    if (curl().easy_setopt(handle, option, value) != CURLE_OK)
      throw std::runtime_error("libcurl does not know an option that is needed: it is too old");
  };
  set(CURLOPT_URL, call.url.c_str());
  set(CURLOPT_PROTOCOLS_STR, "http,https");
  set(CURLOPT_HTTP_VERSION, static_cast<long>(CURL_HTTP_VERSION_1_1));
  set(CURLOPT_PATH_AS_IS, 1L);
  set(CURLOPT_PROXY, "");
  set(CURLOPT_NOSIGNAL, 1L);
  set(CURLOPT_HTTPHEADER, headers.get());
  set(CURLOPT_CONNECTTIMEOUT_MS, static_cast<long>(options_.connect_timeout.count()));
  set(CURLOPT_LOW_SPEED_LIMIT, static_cast<long>(options_.least_bytes_per_s));
  set(CURLOPT_LOW_SPEED_TIME, static_cast<long>(options_.stall_timeout.count()));
  set(CURLOPT_ERRORBUFFER, reason.data());
  if (!options_.ca_file.empty()) set(CURLOPT_CAINFO, options_.ca_file.c_str());
  set(CURLOPT_READFUNCTION, &give_body);
  set(CURLOPT_READDATA, &transfer);
  set(CURLOPT_SEEKFUNCTION, &seek_body);
  set(CURLOPT_SEEKDATA, &transfer);
  set(CURLOPT_WRITEFUNCTION, &take_body);
  set(CURLOPT_WRITEDATA, &transfer);
  set(CURLOPT_HEADERFUNCTION, &take_header);
  set(CURLOPT_HEADERDATA, &transfer);
  set(CURLOPT_NOPROGRESS, 0L);
  set(CURLOPT_XFERINFOFUNCTION, &go_on);
  set(CURLOPT_XFERINFODATA, &transfer);
  set_method(handle, call);

  const CURLcode code = curl().easy_perform(handle);
  if (transfer.thrown) std::rethrow_exception(transfer.thrown);
  long status = 0;
  curl().easy_getinfo(handle, CURLINFO_RESPONSE_CODE, &status);
  transfer.reply.status = static_cast<int>(status);
  if (code != CURLE_OK) {
    transfer.reply.failure = reason.front() == '\0' ? curl().easy_strerror(code) : reason.data();
    if (stopped_) transfer.reply.failure = "the program ends";
    transfer.reply.may_pass = !stopped_ && may_pass_later(code);
  }
  return std::move(transfer.reply);
}

}  // namespace stillmap::server
