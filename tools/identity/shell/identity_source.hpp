#pragma once
#include <filesystem>
#include <string>

#include "common/crypto/crypto.hpp"
#include "common/crypto/identities/renewal.hpp"

/// Where a host's key and certificate lie, and how new ones come there.
namespace ledgerline::identity {

inline std::string text_of(const crypto::IdentitySource& source) {
  return source.msp_dir.empty() ? source.files.certificate : source.msp_dir;
}
/// There is neither a key nor a certificate.
bool is_free(const crypto::IdentitySource& source);

/// Puts a pair there that fits together: first the key (0600), then the certificate by one rename, then the old key
/// goes. In a folder the pair is whole at each moment, whatever dies meanwhile, since of two keys the one that fits
/// counts (crypto::identity_files); of two files the key is new a moment before the certificate, which running programs
/// wait out.
Status put(const crypto::IdentitySource& source, const crypto::Renewal::Pair& pair);

/// A folder of fabric-ca-client's, 0700, beside the place, that goes with this object and with all that is in it.
class Home {
 public:
  static Result<Home> make(const std::string& beside);
  /// With the pair in its msp/, to ask in its name.
  Status put_pair(const crypto::Renewal::Pair& pair) const;
  ~Home();
  Home(Home&& other) noexcept : folder_(std::exchange(other.folder_, {})) {}
  Home& operator=(Home&&) = delete;

  std::string text() const { return folder_.string(); }
  std::string msp() const { return (folder_ / "msp").string(); }

 private:
  explicit Home(std::filesystem::path folder) : folder_(std::move(folder)) {}
  std::filesystem::path folder_;
};

}  // namespace ledgerline::identity
