#include <google/protobuf/stubs/logging.h>

#include <algorithm>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>

#include "tests/fuzz/mutator.hpp"

/// clang's libFuzzer over the same entries: LEDGERLINE_FUZZ_ENTRY says which one, and without it all are listed. The
/// corpus needs no files: our mutator brings the entry's seeds in.
extern "C" std::size_t LLVMFuzzerMutate(std::uint8_t* data, std::size_t size, std::size_t max_size);

namespace ledgerline::fuzz {
namespace {

struct Target {
  Registered registered;
  std::unique_ptr<Entry> entry;
  std::vector<std::string> seeds;
};
Target* target = nullptr;  // never deleted: libFuzzer ends the process without destructors

}  // namespace

std::vector<Registered>& registered() {
  static std::vector<Registered> entries;
  return entries;
}

}  // namespace ledgerline::fuzz

using namespace ledgerline::fuzz;

extern "C" int LLVMFuzzerInitialize(int*, char***) {
  google::protobuf::SetLogHandler(nullptr);
  const char* asked = std::getenv("LEDGERLINE_FUZZ_ENTRY");
  const std::string name = asked ? asked : "";
  for (const Registered& one : registered()) {
    if (one.name == name) target = new Target{one, one.make(), {}};
  }
  if (target == nullptr) {
    for (const Registered& one : registered()) std::printf("%s\n", one.name.c_str());
    std::exit(name.empty() ? 0 : 2);
  }
  target->seeds = target->entry->seeds();
  return 0;
}

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const Outcome outcome = target->entry->feed({reinterpret_cast<const char*>(data), size});
  if (outcome.verdict == Outcome::Verdict::refused && outcome.why.empty()) std::abort();
  return 0;
}

extern "C" std::size_t LLVMFuzzerCustomMutator(std::uint8_t* data, std::size_t size, std::size_t max_size,
                                               unsigned int number) {
  ledgerline::Random random(number);
  if (random.next() % 2 == 0) return LLVMFuzzerMutate(data, size, max_size);
  std::vector<std::string> from = target->seeds;
  if (size > 0 && random.next() % 8 != 0) from = {{reinterpret_cast<const char*>(data), size}};
  const std::string bytes = mutate(random, from, target->registered.kind);
  const std::size_t kept = std::min(bytes.size(), max_size);
  std::memcpy(data, bytes.data(), kept);
  return kept;
}
