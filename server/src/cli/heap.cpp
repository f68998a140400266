/// What jemalloc, which is this program's malloc, asks for at its start (jemalloc(3), TUNING): a
/// heap for each core, and pages that nobody used for 2 s go back. Each thread of a connection
/// holds a scan for a moment; glibc's heaps grow for hours with who held one when. `MALLOC_CONF` in
/// the environment comes after it.
extern "C" {
extern const char* malloc_conf;
const char* malloc_conf = "percpu_arena:percpu,dirty_decay_ms:2000,muzzy_decay_ms:0";
}
