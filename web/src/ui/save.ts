/** Lets the browser save the answer of an address of this origin. */
export function saveAddress(address: string, name: string): void {
  const link = document.createElement('a');
  link.href = address;
  link.download = name;
  link.click();
}

/** Lets the browser save bytes as a file. */
export function saveBlob(blob: Blob, name: string): void {
  const address = URL.createObjectURL(blob);
  saveAddress(address, name);
  // Later, when the browser has started the download.
  setTimeout(() => URL.revokeObjectURL(address), 60_000);
}
