#pragma once
#include <functional>
#include <memory>
#include <ostream>
#include <string>
#include <string_view>
#include <vector>

#include "common/base/result.hpp"

/// Every place where untrusted bytes come in, behind one interface: seeded campaigns (fuzz_test.cpp) and libFuzzer
/// (libfuzzer.cpp) feed the same entries.
namespace ledgerline::fuzz {

/// What became of an input. Where a protocol has no word for a refusal (datagrams of a drone, one-way streams) bad
/// bytes are dropped, and the part counts them.
struct Outcome {
  enum class Verdict { accepted, refused, dropped } verdict = Verdict::accepted;
  std::string why;  ///< of a refusal: for a person, so it must be clear
};
inline Outcome accepted() { return {}; }
inline Outcome refused(std::string why) { return {Outcome::Verdict::refused, std::move(why)}; }
inline Outcome dropped() { return {Outcome::Verdict::dropped, {}}; }
template <typename T>
Outcome outcome_of(const Result<T>& result) {
  return result ? accepted() : refused(result.error().message);
}

/// What an input is made of: which mutations get beyond the first check.
enum class Kind { bytes, protobuf, text, json, toml };

class Entry {
 public:
  virtual ~Entry() = default;
  /// Valid inputs to begin from.
  virtual std::vector<std::string> seeds() = 0;
  /// Must be accepted at any time, whatever came before; made again by each call.
  virtual std::vector<std::string> probes() { return seeds(); }
  /// Must return, and throw nothing.
  virtual Outcome feed(std::string_view bytes) = 0;
};

struct Registered {
  std::string name;  ///< "part.what"
  Kind kind = Kind::bytes;
  std::function<std::unique_ptr<Entry>()> make;
  /// Least share of inputs that are not accepted (a campaign that spoils nothing shows nothing), and of those accepted.
  double least_refused = 0.2, least_accepted = 0.002;
};
/// As tests name it.
inline std::ostream& operator<<(std::ostream& out, const Registered& entry) { return out << entry.name; }
/// Of this program, in the order of registration.
std::vector<Registered>& registered();
/// `const Registration name({...});` at namespace scope registers an entry.
struct Registration {
  explicit Registration(Registered entry) { registered().push_back(std::move(entry)); }
};

/// An entry without memory: a function of the input.
class Function final : public Entry {
 public:
  using Feed = std::function<Outcome(std::string_view)>;
  Function(std::vector<std::string> seeds, Feed feed) : seeds_(std::move(seeds)), feed_(std::move(feed)) {}
  std::vector<std::string> seeds() override { return seeds_; }
  Outcome feed(std::string_view bytes) override { return feed_(bytes); }

 private:
  std::vector<std::string> seeds_;
  Feed feed_;
};

}  // namespace ledgerline::fuzz
