#include <sys/stat.h>

#include "common/base/file.hpp"
#include "common/crypto/crypto.hpp"
#include "ground/service/shell/server.hpp"

namespace ledgerline::ground::service {

Result<std::string> read_token(const std::string& file) {
  if (file.empty()) return Error{"must name a file: anyone who knows what is in it may fly"};
  struct stat status {};
  if (::stat(file.c_str(), &status) != 0) {
    const std::string token = crypto::hex(crypto::random_bytes(token_digits / 2));
    if (auto written = replace_file(file, token + "\n", 0600); !written) return written.error();
    return token;
  }
  if ((status.st_mode & 077) != 0) return Error{file + " may be read by others: chmod 600 " + file};
  auto text = read_file(file);
  if (!text) return text.error();
  while (!text->empty() && text->back() == '\n') text->pop_back();
  if (text->size() != token_digits || text->find_first_not_of("0123456789abcdef") != std::string::npos)
    return Error{file + " must hold 64 hex digits; without the file a new one is made"};
  return text;
}

}  // namespace ledgerline::ground::service
