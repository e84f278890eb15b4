#include <google/protobuf/stubs/logging.h>
#include <gtest/gtest.h>
#include <signal.h>
#include <unistd.h>

#include <chrono>
#include <cstdio>
#include <sstream>

#include "tests/fuzz/mutator.hpp"
#include "tests/unit/campaign.hpp"

// The sanitizers call it before they end the program.
extern "C" void __sanitizer_set_death_callback(void (*)()) __attribute__((weak));

/// Spoilt inputs for every entry: no crash, no hang, a clear refusal each, and valid inputs go on being
/// taken. An input is made from its number alone (and the entry's seeds), and printed when it fails.
namespace ledgerline::fuzz {
namespace {

constexpr unsigned hang_s = 20;
constexpr std::size_t probe_every = 1'000;
constexpr std::size_t max_refusal = 2'000;  // a person reads it, and gRPC carries no more than 8 kB beside an answer

struct Current {
  const char* entry = "";
  std::uint64_t number = 0;
  std::string_view input;
} current;

std::string escaped(std::string_view bytes) {
  std::string text;
  for (const char c : bytes) {
    if (c >= ' ' && c <= '~' && c != '\\' && c != '"') {
      text += c;
      continue;
    }
    char code[5];
    std::snprintf(code, sizeof code, "\\%03o", static_cast<unsigned>(static_cast<unsigned char>(c)));
    text += code;
  }
  return text;
}

// Octal escapes, so that a C++ or shell string of it is the same input again.
std::string place() {
  return std::string(current.entry) + ", input " + std::to_string(current.number) + ": \"" + escaped(current.input) +
         "\"";
}

void say_place() { std::fprintf(stderr, "while fed to %s\n", place().c_str()); }

void on_signal(int signal) {
  if (signal == SIGALRM) std::fprintf(stderr, "no end after %u s\n", hang_s);
  say_place();
  ::signal(signal, SIG_DFL);
  if (signal == SIGALRM) std::abort();
  ::raise(signal);
}

bool is_utf8(std::string_view text) {
  for (std::size_t i = 0; i < text.size();) {
    const auto c = static_cast<unsigned char>(text[i]);
    const std::size_t size = c < 0x80                ? 1
                             : c >= 0xc2 && c < 0xe0 ? 2
                             : c >= 0xe0 && c < 0xf0 ? 3
                             : c >= 0xf0 && c < 0xf5 ? 4
                                                     : 0;
    if (size == 0 || i + size > text.size()) return false;
    for (std::size_t k = 1; k < size; ++k) {
      if ((text[i + k] & 0xc0) != 0x80) return false;
    }
    i += size;
  }
  return true;
}

/// Empty, or what a person could not read about it.
std::string unclear(const std::string& why) {
  if (why.find_first_not_of(" \t\r\n.:") == std::string::npos) return "an empty refusal";
  if (why.find('\n') != std::string::npos) {  // a config file's mistakes come all at once, a line each
    std::istringstream lines(why);
    for (std::string line; std::getline(lines, line);) {
      if (auto wrong = unclear(line); !wrong.empty()) return wrong;
    }
    return {};
  }
  if (why.size() > max_refusal) {
    return "a refusal of " + std::to_string(why.size()) + " bytes: " + escaped(why.substr(0, 300));
  }
  if (!is_utf8(why)) return "a refusal that is no UTF-8: " + escaped(why);
  for (const char c : why) {
    if (static_cast<unsigned char>(c) < ' ') return "a refusal with control characters: " + escaped(why);
  }
  return {};
}

class HostileBytes : public ::testing::TestWithParam<Registered> {
 protected:
  HostileBytes() {
    if (__sanitizer_set_death_callback) __sanitizer_set_death_callback(say_place);
    google::protobuf::SetLogHandler(nullptr);  // a line for each string that is no UTF-8
    for (const int signal : {SIGALRM, SIGABRT}) ::signal(signal, on_signal);
  }
  ~HostileBytes() override {
    ::alarm(0);
    current = {};
  }

  Outcome feed(Entry& entry, std::uint64_t number, std::string_view input) {
    current = {GetParam().name.c_str(), number, input};
    ::alarm(hang_s);
    return entry.feed(input);
  }

  void probe(Entry& entry) {
    for (const std::string& valid : entry.probes()) {
      const Outcome outcome = feed(entry, 0, valid);
      ASSERT_EQ(outcome.verdict, Outcome::Verdict::accepted) << "a valid input: " << outcome.why << "\n" << place();
    }
  }
};

TEST_P(HostileBytes, AreRefusedClearlyAndDoNoHarm) {
  const auto entry = GetParam().make();
  const std::vector<std::string> valid = entry->seeds();
  ASSERT_NO_FATAL_FAILURE(probe(*entry));
  const auto inputs = static_cast<std::uint64_t>(seeds(2'000, 200'000));
  std::size_t taken = 0, refused = 0, dropped = 0;
  using Clock = std::chrono::steady_clock;
  const auto start = Clock::now();
  Clock::duration max_duration{};
  std::uint64_t slowest = 0;
  for (std::uint64_t number = 1; number <= inputs; ++number) {
    Random random(number);
    const std::string input = mutate(random, valid, GetParam().kind);
    const auto before = Clock::now();
    Outcome outcome;
    try {
      outcome = feed(*entry, number, input);
    } catch (const std::exception& e) {
      FAIL() << "threw " << e.what() << "\n" << place();
    }
    if (Clock::now() - before > max_duration) {
      max_duration = Clock::now() - before;
      slowest = number;
    }
    switch (outcome.verdict) {
      case Outcome::Verdict::accepted:
        ++taken;
        break;
      case Outcome::Verdict::dropped:
        ++dropped;
        break;
      case Outcome::Verdict::refused:
        ++refused;
        ASSERT_EQ(unclear(outcome.why), "") << place();
    }
    if (number % probe_every == 0) {
      ASSERT_NO_FATAL_FAILURE(probe(*entry));
    }
  }
  const auto seconds = [](Clock::duration d) { return std::chrono::duration<double>(d).count(); };
  std::printf("[  inputs  ] %-32s %6zu refused %6zu dropped %6zu accepted %7.2f s, maximum %.1f ms (input %llu)\n",
              GetParam().name.c_str(), refused, dropped, taken, seconds(Clock::now() - start),
              1e3 * seconds(max_duration), static_cast<unsigned long long>(slowest));
  const auto all = static_cast<double>(inputs);
  EXPECT_GE(static_cast<double>(refused + dropped), GetParam().least_refused * all);
  EXPECT_GE(static_cast<double>(taken), GetParam().least_accepted * all);
}

INSTANTIATE_TEST_SUITE_P(Entry, HostileBytes, ::testing::ValuesIn(registered()), [](const auto& test) {
  std::string name;
  for (const char c : test.param.name) name += c == '.' ? '_' : c;
  return name;
});

}  // namespace

std::vector<Registered>& registered() {
  static std::vector<Registered> entries;
  return entries;
}

}  // namespace ledgerline::fuzz
