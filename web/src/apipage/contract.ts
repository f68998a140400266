/** What the page reads of the server's OpenAPI document. */
export interface Contract {
  paths?: Record<string, Record<string, Operation>>;
}

interface Operation {
  operationId?: string;
  tags?: string[];
  description?: string;
  security?: Record<string, string[]>[];
}

/** The tag of an operation, by which Swagger UI finds it; undefined when the document has no such operation. */
export function tagOf(contract: Contract, operationId: string): string | undefined {
  const operation = operations(contract).find((one) => one.operationId === operationId);
  return operation && (operation.tags?.[0] ?? 'default');
}

/** The document, with a sentence in each operation that says which key it needs: Swagger UI does not show scopes. */
export function withScopes(contract: Contract): Contract {
  const named = structuredClone(contract);
  for (const operation of operations(named)) {
    const scopes = operation.security?.flatMap((one) => Object.values(one).flat()) ?? [];
    const sentence = scopes.length === 0 ? 'Needs no key.' : `Needs a key with the scope \`${scopes.join('`, `')}\`, if the server uses keys.`;
    operation.description = [operation.description, sentence].filter((text) => text !== undefined).join('\n\n');
  }
  return named;
}

function operations(contract: Contract): Operation[] {
  return Object.values(contract.paths ?? {}).flatMap((methods) => Object.values(methods));
}
