#pragma once

#include <curl/curl.h>

namespace stillmap::server {

/// libcurl, loaded when it is needed first: a server without S3 neither needs the package nor pays
/// for the 22 libraries that come with it. Stays loaded.
struct CurlLibrary {
  decltype(&::curl_easy_init) easy_init;
  decltype(&::curl_easy_setopt) easy_setopt;
  decltype(&::curl_easy_perform) easy_perform;
  decltype(&::curl_easy_getinfo) easy_getinfo;
  decltype(&::curl_easy_reset) easy_reset;
  decltype(&::curl_easy_cleanup) easy_cleanup;
  decltype(&::curl_easy_strerror) easy_strerror;
  decltype(&::curl_slist_append) slist_append;
  decltype(&::curl_slist_free_all) slist_free_all;

  /// @throws maps::InputError when it is not installed or too old.
  static const CurlLibrary& get();
};

}  // namespace stillmap::server
