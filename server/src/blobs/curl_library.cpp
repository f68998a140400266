#include "blobs/curl_library.hpp"

#include <stillmap/maps/error.hpp>

#include <dlfcn.h>

#include <string>

namespace stillmap::server {
namespace {

constexpr const char* kCurlName = "libcurl.so.4";
constexpr const char* kCurlExpected = "libcurl 7.85 or newer: install the package libcurl4";

template <typename Function>
void find_symbol(void* library, const char* name, Function& function) {
  function = reinterpret_cast<Function>(::dlsym(library, name));
  if (function == nullptr)
    throw maps::InputError(kCurlName, std::string("no ") + name, kCurlExpected);
}

CurlLibrary load_curl() {
  void* const library = ::dlopen(kCurlName, RTLD_NOW | RTLD_LOCAL);
  if (library == nullptr) {
    const char* const reason = ::dlerror();
    throw maps::InputError(kCurlName, reason == nullptr ? "nothing" : reason, kCurlExpected);
  }
  CurlLibrary curl{};
  find_symbol(library, "curl_easy_init", curl.easy_init);
  find_symbol(library, "curl_easy_setopt", curl.easy_setopt);
  find_symbol(library, "curl_easy_perform", curl.easy_perform);
  find_symbol(library, "curl_easy_getinfo", curl.easy_getinfo);
  find_symbol(library, "curl_easy_reset", curl.easy_reset);
  find_symbol(library, "curl_easy_cleanup", curl.easy_cleanup);
  find_symbol(library, "curl_easy_strerror", curl.easy_strerror);
  find_symbol(library, "curl_slist_append", curl.slist_append);
  find_symbol(library, "curl_slist_free_all", curl.slist_free_all);
  decltype(&::curl_global_init) global_init = nullptr;
  find_symbol(library, "curl_global_init", global_init);
  if (global_init(CURL_GLOBAL_DEFAULT) != CURLE_OK)
    throw maps::InputError(kCurlName, "a library that does not start", kCurlExpected);
  return curl;
}

}  // namespace

const CurlLibrary& CurlLibrary::get() {
  static const CurlLibrary library = load_curl();
  return library;
}

}  // namespace stillmap::server
