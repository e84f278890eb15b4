// Preloaded (LD_PRELOAD) into ledgerline-link as it is: watches what its real-time loop does. The first thread that
// sleeps until a point in time is the loop. From then on every call that it makes of the heap, of a lock, a condition
// or a throw is noted by the functions below, which stand in front of libc's and libstdc++'s own (operator new comes
// down to malloc), and every system call but the allowed ones by the kernel: a seccomp filter of that thread hands it
// to another thread here, which notes it and lets it pass. A turn counts once the next one begins, so what the thread
// does after its last turn, to end, does not. At exit the file LOOP_WATCH_REPORT gets the turns and each offence with
// its first call stack.
//
// With LOOP_WATCH_SHIM=1, for link's loop over the shim, the clock and the sleep alone are allowed.
//
// With LOOP_WATCH_LOCKS=PROGRAM it watches that program's main thread instead, from the first time that it waits for
// two descriptors, as agent's main loop does, and for locks and conditions alone. Each caller is an offence of its own,
// reported as its file and the offset in that file, so that a program's own locks differ from its libraries'.
#include <dlfcn.h>
#include <execinfo.h>
#include <linux/filter.h>
#include <linux/seccomp.h>
#include <poll.h>
#include <pthread.h>
#include <sys/ioctl.h>
#include <sys/prctl.h>
#include <sys/socket.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <array>
#include <atomic>
#include <cerrno>
#include <csignal>
#include <cstddef>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <ctime>

namespace {

struct Offence {
  const char* what = nullptr;
  int number = 0;          ///< of a system call
  void* caller = nullptr;  ///< where only locks are watched
  unsigned long count = 0, in_this_turn = 0;
  std::array<void*, 16> stack{};
  int depth = 0;
};

// Written by the loop's thread, and by the other one while the loop waits for it.
std::array<Offence, 512> offences;
unsigned long turns = 0;
const char* problem = nullptr;
std::atomic<int> listener{-1};
std::atomic<bool> begun{false};
bool locks_only = false, elsewhere = false;  ///< only locks, of this program; of another one

// Not allocated on first use, which would be a call of malloc within malloc.
__attribute__((tls_model("initial-exec"))) thread_local bool watched = false;
__attribute__((tls_model("initial-exec"))) thread_local bool noting = false;

Offence* find(const char* what, int number, void* caller = nullptr) {
  for (Offence& offence : offences) {
    if (!offence.what) {
      offence.what = what;
      offence.number = number;
      offence.caller = caller;
    }
    if (std::strcmp(offence.what, what) == 0 && offence.number == number && offence.caller == caller) return &offence;
  }
  return &offences.back();
}

void note(const char* what, void* caller) {
  if (!watched || noting) return;
  noting = true;
  Offence* offence = find(what, 0, locks_only ? caller : nullptr);
  ++offence->in_this_turn;
  if (offence->depth == 0) offence->depth = ::backtrace(offence->stack.data(), static_cast<int>(offence->stack.size()));
  noting = false;
}

// The kernel's side: see seccomp_unotify(2).
void* let_calls_pass(void*) {
  while (listener < 0) ::usleep(1000);
  seccomp_notif call{};
  while (::ioctl(listener, SECCOMP_IOCTL_NOTIF_RECV, &call) == 0 || errno == EINTR) {
    Offence* offence = find("system call", call.data.nr);
    ++offence->in_this_turn;
    offence->stack[0] = reinterpret_cast<void*>(call.data.instruction_pointer);
    offence->depth = 1;
    seccomp_notif_resp pass{};
    pass.id = call.id;
    pass.flags = SECCOMP_USER_NOTIF_FLAG_CONTINUE;
    ::ioctl(listener, SECCOMP_IOCTL_NOTIF_SEND, &pass);
    call = {};
  }
  return nullptr;
}

// Only clock, sleep until a time, and receive and send where their flags say that they do not wait.
int filter_calls() {
  std::array<sock_filter, 10> program{{
      BPF_STMT(BPF_LD | BPF_W | BPF_ABS, offsetof(seccomp_data, nr)),
      BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, SYS_clock_gettime, 7, 0),
      BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, SYS_clock_nanosleep, 6, 0),
      BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, SYS_recvfrom, 2, 0),
      BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, SYS_recvmmsg, 1, 0),
      BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, SYS_sendto, 0, 2),
      BPF_STMT(BPF_LD | BPF_W | BPF_ABS, offsetof(seccomp_data, args[3])),
      BPF_JUMP(BPF_JMP | BPF_JSET | BPF_K, MSG_DONTWAIT, 1, 0),
      BPF_STMT(BPF_RET | BPF_K, SECCOMP_RET_USER_NOTIF),
      BPF_STMT(BPF_RET | BPF_K, SECCOMP_RET_ALLOW),
  }};
  std::array<sock_filter, 5> of_shim{{
      BPF_STMT(BPF_LD | BPF_W | BPF_ABS, offsetof(seccomp_data, nr)),
      BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, SYS_clock_gettime, 2, 0),
      BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, SYS_clock_nanosleep, 1, 0),
      BPF_STMT(BPF_RET | BPF_K, SECCOMP_RET_USER_NOTIF),
      BPF_STMT(BPF_RET | BPF_K, SECCOMP_RET_ALLOW),
  }};
  const bool shim = std::getenv("LOOP_WATCH_SHIM") != nullptr;
  const sock_fprog filter{static_cast<unsigned short>(shim ? of_shim.size() : program.size()),
                          shim ? of_shim.data() : program.data()};
  ::prctl(PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0);
  return static_cast<int>(::syscall(SYS_seccomp, SECCOMP_SET_MODE_FILTER, SECCOMP_FILTER_FLAG_NEW_LISTENER, &filter));
}

void begin_watch() {
  if (begun.exchange(true)) return;
  if (locks_only) {
    watched = true;
    return;
  }
  const int fd = filter_calls();
  if (fd < 0) problem = std::strerror(errno);
  watched = true;
  listener = fd;
}

void end_turn() {
  ++turns;
  for (Offence& offence : offences) {
    offence.count += offence.in_this_turn;
    offence.in_this_turn = 0;
  }
}

__attribute__((constructor)) void prepare() {
  if (const char* program = std::getenv("LOOP_WATCH_LOCKS")) {
    locks_only = std::strcmp(program, program_invocation_short_name) == 0;
    elsewhere = !locks_only;
    if (elsewhere) return;
  }
  std::array<void*, 1> none{};
  (void)::backtrace(none.data(), 1);  // loads what it needs
  if (locks_only) return;
  // The program's signals are for the program's own threads.
  sigset_t all, before;
  sigfillset(&all);
  ::pthread_sigmask(SIG_SETMASK, &all, &before);
  pthread_t thread{};
  ::pthread_create(&thread, nullptr, let_calls_pass, nullptr);
  ::pthread_sigmask(SIG_SETMASK, &before, nullptr);
}

__attribute__((destructor)) void report() {
  const char* path = std::getenv("LOOP_WATCH_REPORT");
  std::FILE* file = path && !elsewhere ? std::fopen(path, "w") : nullptr;
  if (!file) return;
  std::fprintf(file, "turns %lu\n", turns);
  if (problem) std::fprintf(file, "system calls are not watched: %s\n", problem);
  for (const Offence& offence : offences) {
    if (offence.count == 0) continue;
    std::fprintf(file, "%s", offence.what);
    if (offence.number != 0) std::fprintf(file, " %d", offence.number);
    if (Dl_info place{}; offence.caller && ::dladdr(offence.caller, &place) != 0) {
      std::fprintf(
          file, ": %lu x, by %s+0x%lx\n", offence.count, place.dli_fname,
          static_cast<unsigned long>(static_cast<char*>(offence.caller) - static_cast<char*>(place.dli_fbase)));
      continue;
    }
    std::fprintf(file, ": %lu x, first from\n", offence.count);
    std::fflush(file);
    ::backtrace_symbols_fd(offence.stack.data(), offence.depth, ::fileno(file));
  }
  std::fclose(file);
}

using Function = long (*)(long, long, long, long);

Function next(Function& known, const char* name) {
  if (!known) known = reinterpret_cast<Function>(::dlsym(RTLD_NEXT, name));
  return known;
}

}  // namespace

extern "C" int clock_nanosleep(clockid_t clock, int flags, const timespec* at, timespec* left) {
  static Function real = nullptr;
  if (flags == TIMER_ABSTIME && !locks_only && !elsewhere) begin_watch();
  if (watched) end_turn();
  return static_cast<int>(
      next(real, "clock_nanosleep")(clock, flags, reinterpret_cast<long>(at), reinterpret_cast<long>(left)));
}

extern "C" int ppoll(pollfd* fds, nfds_t count, const timespec* timeout, const sigset_t* mask) {
  static Function real = nullptr;
  const bool loop = locks_only && ::getpid() == ::gettid();
  if (loop && count == 2 && fds[1].fd >= 0) begin_watch();
  if (loop && watched) end_turn();
  return static_cast<int>(next(real, "ppoll")(reinterpret_cast<long>(fds), static_cast<long>(count),
                                              reinterpret_cast<long>(timeout), reinterpret_cast<long>(mask)));
}

// Whatever they are declared as: at most four words come in and one goes out, in registers.
#define WATCH(name, stand_in, real_function, noted)                        \
  extern "C" long stand_in(long a, long b, long c, long d) __asm__(#name); \
  extern "C" long stand_in(long a, long b, long c, long d) {               \
    if (noted) note(#name, __builtin_return_address(0));                   \
    return real_function(a, b, c, d);                                      \
  }
#define WATCH_NEXT_IF(name, noted)                          \
  static long next_##name(long a, long b, long c, long d) { \
    static Function real = nullptr;                         \
    return next(real, #name)(a, b, c, d);                   \
  }                                                         \
  WATCH(name, stand_in_for_##name, next_##name, noted)
#define WATCH_NEXT(name) WATCH_NEXT_IF(name, !locks_only)
#define WATCH_LOCK(name) WATCH_NEXT_IF(name, true)
// dlsym may allocate.
#define WATCH_HEAP(name)                                                        \
  extern "C" long libc_##name(long, long, long, long) __asm__("__libc_" #name); \
  WATCH(name, stand_in_for_##name, libc_##name, !locks_only)

WATCH_HEAP(malloc)
WATCH_HEAP(calloc)
WATCH_HEAP(realloc)
WATCH_HEAP(free)
WATCH_HEAP(memalign)
WATCH_NEXT(aligned_alloc)
WATCH_NEXT(posix_memalign)
WATCH_NEXT(reallocarray)
WATCH_NEXT(valloc)
WATCH_NEXT(pvalloc)

WATCH_LOCK(pthread_mutex_lock)
WATCH_LOCK(pthread_mutex_trylock)
WATCH_LOCK(pthread_mutex_timedlock)
WATCH_LOCK(pthread_mutex_clocklock)
WATCH_LOCK(pthread_mutex_unlock)
WATCH_LOCK(pthread_cond_wait)
WATCH_LOCK(pthread_cond_timedwait)
WATCH_LOCK(pthread_cond_clockwait)
WATCH_LOCK(pthread_cond_signal)
WATCH_LOCK(pthread_cond_broadcast)
WATCH_LOCK(pthread_rwlock_rdlock)
WATCH_LOCK(pthread_rwlock_tryrdlock)
WATCH_LOCK(pthread_rwlock_timedrdlock)
WATCH_LOCK(pthread_rwlock_clockrdlock)
WATCH_LOCK(pthread_rwlock_wrlock)
WATCH_LOCK(pthread_rwlock_trywrlock)
WATCH_LOCK(pthread_rwlock_timedwrlock)
WATCH_LOCK(pthread_rwlock_clockwrlock)
WATCH_LOCK(pthread_rwlock_unlock)
WATCH_LOCK(pthread_spin_lock)
WATCH_LOCK(sem_wait)
WATCH_LOCK(sem_trywait)
WATCH_LOCK(sem_timedwait)
WATCH_LOCK(sem_clockwait)
WATCH_LOCK(sem_post)

WATCH_NEXT(__cxa_throw)
WATCH_NEXT(__cxa_rethrow)
