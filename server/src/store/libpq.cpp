#include "store/libpq.hpp"

#include <stillmap/maps/error.hpp>

#include <dlfcn.h>

namespace stillmap::server {
namespace {

constexpr const char* kLibrary = "libpq.so.5";

template <typename Function>
void find(void* library, const char* name, Function& function) {
  function = reinterpret_cast<Function>(dlsym(library, name));
  if (function == nullptr)
    throw maps::InputError(kLibrary, std::string("no function ") + name,
                           "PostgreSQL's client library of version 15 or newer: install libpq5");
}

Libpq loaded() {
  void* const library = dlopen(kLibrary, RTLD_NOW | RTLD_LOCAL);
  if (library == nullptr)
    throw maps::InputError(kLibrary, dlerror(),
                           "PostgreSQL's client library: install the package libpq5");
  Libpq pq{};
  find(library, "PQconnectdbParams", pq.connect);
  find(library, "PQfinish", pq.finish);
  find(library, "PQstatus", pq.status);
  find(library, "PQerrorMessage", pq.error);
  find(library, "PQsetnonblocking", pq.set_nonblocking);
  find(library, "PQsendQuery", pq.send_query);
  find(library, "PQsendQueryParams", pq.send_params);
  find(library, "PQflush", pq.flush);
  find(library, "PQisBusy", pq.is_busy);
  find(library, "PQgetResult", pq.next_result);
  find(library, "PQresultStatus", pq.result_status);
  find(library, "PQresultErrorField", pq.error_field);
  find(library, "PQresultErrorMessage", pq.result_error);
  find(library, "PQclear", pq.clear);
  find(library, "PQntuples", pq.rows);
  find(library, "PQgetvalue", pq.value);
  find(library, "PQgetlength", pq.length);
  find(library, "PQgetisnull", pq.is_null);
  find(library, "PQcmdTuples", pq.changed);
  find(library, "PQcmdStatus", pq.command);
  find(library, "PQtransactionStatus", pq.transaction);
  find(library, "PQsetNoticeReceiver", pq.on_notice);
  find(library, "PQsocket", pq.socket);
  find(library, "PQconsumeInput", pq.consume);
  find(library, "PQnotifies", pq.notification);
  find(library, "PQfreemem", pq.free);
  find(library, "PQconninfoParse", pq.parse);
  find(library, "PQconninfoFree", pq.free_parsed);
  return pq;
}

}  // namespace

const Libpq& libpq() {
  static const Libpq pq = loaded();
  return pq;
}

}  // namespace stillmap::server
