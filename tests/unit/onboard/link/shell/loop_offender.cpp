// A loop that breaks one rule in each turn, for the test of the watch: loop_offender RULE [polls]. With the second word
// it waits as agent's main loop does, else as link's.
#include <poll.h>
#include <pthread.h>
#include <sys/socket.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <array>
#include <cstdlib>
#include <ctime>
#include <string_view>
#include <utility>

namespace {

void* volatile kept = nullptr;  // so that no allocation is optimised away
int volatile number = 0;
std::array<int, 2> sockets;
pthread_mutex_t mutex = PTHREAD_MUTEX_INITIALIZER;
pthread_cond_t condition = PTHREAD_COND_INITIALIZER;
pthread_rwlock_t rwlock = PTHREAD_RWLOCK_INITIALIZER;

struct alignas(256) Wide {
  char bytes[256];
};

struct Rule {
  std::string_view name;
  void (*act)();
};
constexpr std::array rules{
    Rule{"none",
         [] {
           char byte = 0;
           (void)!::send(sockets[0], "", 1, MSG_DONTWAIT);
           (void)!::recv(sockets[1], &byte, 1, MSG_DONTWAIT);
           timespec now{};
           ::clock_gettime(CLOCK_MONOTONIC, &now);
         }},
    Rule{"wake", [] { (void)!::send(sockets[0], "", 1, MSG_DONTWAIT); }},
    Rule{"clock",
         [] {
           timespec now{};
           number = static_cast<int>(::syscall(SYS_clock_gettime, CLOCK_MONOTONIC, &now));
         }},
    Rule{"malloc", [] { kept = std::malloc(100); }},
    Rule{"calloc", [] { kept = std::calloc(10, 10); }},
    Rule{"realloc", [] { kept = std::realloc(kept, 200); }},
    Rule{"free", [] { std::free(std::exchange(kept, nullptr)); }},
    Rule{"aligned_alloc", [] { kept = std::aligned_alloc(64, 128); }},
    Rule{"posix_memalign", [] { number = ::posix_memalign(const_cast<void**>(&kept), 64, 128); }},
    Rule{"new", [] { kept = new int; }},
    Rule{"aligned new", [] { kept = new Wide; }},
    Rule{"mutex", [] { number = ::pthread_mutex_lock(&mutex) + ::pthread_mutex_unlock(&mutex); }},
    Rule{"trylock", [] { number = ::pthread_mutex_trylock(&mutex) + ::pthread_mutex_unlock(&mutex); }},
    Rule{"condition", [] { number = ::pthread_cond_signal(&condition); }},
    Rule{"rwlock", [] { number = ::pthread_rwlock_rdlock(&rwlock) + ::pthread_rwlock_unlock(&rwlock); }},
    Rule{"throw",
         [] {
           try {
             throw 1;
           } catch (int caught) {
             number = caught;
           }
         }},
    Rule{"write", [] { (void)!::write(sockets[0], "", 1); }},
    Rule{"waiting receive",
         [] {
           char byte = 0;
           (void)!::send(sockets[0], "", 1, MSG_DONTWAIT);
           (void)!::recv(sockets[1], &byte, 1, 0);
         }},
    Rule{"system call", [] { number = static_cast<int>(::syscall(SYS_getppid)); }},
};

}  // namespace

int main(int argc, char** argv) {
  const std::string_view asked = argc > 1 ? argv[1] : "";
  const bool polls = argc > 2;
  if (::socketpair(AF_UNIX, SOCK_DGRAM, 0, sockets.data()) != 0) return 1;
  for (const Rule& rule : rules) {
    if (rule.name != asked) continue;
    for (int turn = 0; turn < 5; ++turn) {
      const timespec past{};
      if (polls) {
        std::array<pollfd, 2> fds{pollfd{sockets[0], POLLIN, 0}, pollfd{sockets[1], POLLIN, 0}};
        (void)::ppoll(fds.data(), fds.size(), &past, nullptr);
      } else {
        ::clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &past, nullptr);
      }
      rule.act();
    }
    return 0;
  }
  return 2;
}
